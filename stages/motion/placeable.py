"""Tests of whether photos can be placed at all, and sentences that say what is missing where they cannot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline import UserError
from stages.motion.pairs import Pair, sample, shows_depth, still_share
from stages.motion.sfm_settings import PairSettings
from stages.scene.wording import listed

OVERLAP = (
    "They need to show the same textured, unmoving surface, about two thirds of it again from one to the "
    "next; add photos in between."
)


def check_placeable(
    pairs: Sequence[Pair], names: Sequence[str], fewest: int, settings: PairSettings, where: str
) -> None:
    """Refuse photos of which no pair can begin a model, or whose model would be wrong.

    Parameters
    ----------
    pairs : sequence of Pair
        Verified, those with the most matches first.
    names : sequence of str
        Of all photos.
    fewest : int
        Matches that a first pair must share.
    settings : PairSettings
    where : str
        The photos' folder, for the message.

    Raises
    ------
    UserError
        No pair shares enough matches, most stand still in part, or hardly one shows parallax.
    """
    enough = [pair for pair in pairs if len(pair) >= fewest]
    count = len(names)
    if not enough:
        raise UserError(
            f"The {count} photos of {where} could not be placed: no two share enough features. "
            f"{_best(pairs, names)}; a first pair needs {fewest} (sfm.mapping.init_inliers). {OVERLAP}"
        )
    tried = sample(enough, settings.tried)
    still = [share for pair in tried if (share := still_share(pair, settings)) >= settings.still_part]
    if len(still) > settings.still_pairs * len(tried):
        raise UserError(
            f"The {count} photos of {where} cannot be placed: in {len(still)} of {len(tried)} matching pairs "
            f"a part of the picture stands still ({np.median(still):.0%} of the matches lie at the same "
            "pixels in both photos). That is a turntable before a background that does not turn with it, or "
            "one photo copied. Give masks of what turns and nothing else (--masks, or alpha channels) and "
            "set sfm.within_masks=true, cover the background with plain cloth, walk around the object "
            "instead, or leave out the copies."
        )
    wanted = settings.parallax_pairs * len(tried)
    deep = 0
    for pair in tried:
        deep += shows_depth(pair, settings)
        if deep >= wanted:
            break
    else:
        raise UserError(
            f"The {count} photos of {where} cannot be placed: they share features ({len(enough[0])} between "
            f"{_named(enough[0], names)}), but seem to be taken from one place. Turning the camera alone "
            f"explains {len(tried) - deep} of {len(tried)} matching pairs. Depth needs a baseline: take "
            "a step to the side between photos, about a tenth of the distance to the object."
        )


def no_model(pairs: Sequence[Pair], names: Sequence[str], where: str) -> str:
    """Say that enough was shared and the mapper found no model in spite of it."""
    return (
        f"The {len(names)} photos of {where} could not be placed. {_best(pairs, names)}, enough to "
        "begin with, but no two poses and focal length explain them. The angle between the photos may be "
        "too small (step farther to the side), or the first guess of the focal length wrong "
        "(sfm.camera_params, or sfm.focal_factor). Add photos in between."
    )


def left_out(
    placed: Sequence[Sequence[int]], pairs: Sequence[Pair], names: Sequence[str], fewest: int
) -> list[str]:
    """Say which photos the largest model lacks, what they share with it, and what to photograph.

    Parameters
    ----------
    placed : sequence of sequence of int
        Photos of each model, the largest first.
    pairs : sequence of Pair
    names : sequence of str
        Of all photos.
    fewest : int
        Matches that a further photo needs.

    Returns
    -------
    list of str
        Sentences; none where no photo is left out.
    """
    kept = set(placed[0])
    missing = [name for index, name in enumerate(names) if index not in kept]
    if not missing:
        return []
    said = [f"{len(missing)} of {len(names)} photos could not be placed and are left out: {listed(missing)}."]
    parts = [[names[index] for index in part] for part in placed[1:] if not kept.issuperset(part)]
    if parts:
        among = "; ".join(f"{len(part)} ({listed(part, 3)})" for part in parts)
        said.append(
            f"The photos fell into {len(parts) + 1} parts that do not connect. The largest is kept, of "
            f"{len(kept)} photos; not kept: {among}. Photos in between would join them."
        )
    return [*said, _advice(pairs, names, kept, fewest)]


def _advice(pairs: Sequence[Pair], names: Sequence[str], placed: set[int], fewest: int) -> str:
    """Say what the photos that are left out share with those that are placed, and what to photograph."""
    across = [pair for pair in pairs if (pair.one.photo in placed) != (pair.other.photo in placed)]
    if not across:
        return (
            "No photo that is left out shares a feature with one that is placed: if they show the same "
            "object, photograph what lies between, in small steps; else take them away."
        )
    return (
        f"Of photos left out and placed ones, {_named(across[0], names)} share the most: {len(across[0])} "
        f"matches, not all of them on points with depth, of which a further photo needs {fewest}. "
        "Photograph again, sharply, what is left out, and in between."
    )


def _best(pairs: Sequence[Pair], names: Sequence[str]) -> str:
    if not pairs:
        return "No pair has a match that agrees with one motion of the camera"
    return f"The best pair, {_named(pairs[0], names)}, has {len(pairs[0])} matches that agree with one motion"


def _named(pair: Pair, names: Sequence[str]) -> str:
    return f"{names[pair.one.photo]} and {names[pair.other.photo]}"
