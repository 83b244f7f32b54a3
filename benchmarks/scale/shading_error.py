"""Error of a street's shading, by brightness: ``python -m benchmarks.scale.shading_error [--views 30]``.

Compares the shading that a run of `benchmarks.scale` left, as far as `lighting` at least, with the photos
over the true albedo, in the first views: these show the same bays in a street of any length. It tells a light
that is wrong from an albedo that is solved badly.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.scale.albedo_error import SHARED
from benchmarks.scale.photo_set import PhotoSet
from stages.evaluation.octave_bands import smooth_inside
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_photo

ROOT = Path(__file__).resolve().parent.parent.parent
NOISE_PX = 4.0  # σ of the Gaussian that takes the noise of photos and quantisation out
PARTS = 10  # of the pixels, from dark to bright


@dataclass(frozen=True)
class Part:
    """Error of the shading of pixels that are about as bright.

    Attributes
    ----------
    brightest : float
        True shading, green, of the brightest of them.
    mean, deviation : ndarray, shape (3,)
        Of the logarithms of found over true shading, by channel.
    """

    brightest: float
    mean: np.ndarray
    deviation: np.ndarray


def main(argv: Sequence[str] | None = None) -> None:
    """Compare, and print a line for every part, then one for all."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--views", type=int, default=30, help="of the street")
    parser.add_argument("--size", default="640x400", help="of a view, px")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "scale")
    given = parser.parse_args(argv)
    photos = PhotoSet(given.workspace / f"{given.views}-{given.size}", given.views)
    shading = photos.folder / "workspace" / "output" / "shading"
    if not shading.is_dir():
        parser.error(f"{shading} is not there; run python -m benchmarks.scale --views {given.views} first")
    true, error = errors_of(photos, shading)
    for part in by_brightness(true, error):
        mean, deviation = (" ".join(f"{one:7.4f}" for one in own) for own in (part.mean, part.deviation))
        print(f"shading up to {part.brightest:.3f}: mean of logarithms {mean}, deviation {deviation}")
    print("all: deviation " + " ".join(f"{one:.4f}" for one in error.std(axis=0)))


def errors_of(photos: PhotoSet, shading: Path) -> tuple[np.ndarray, np.ndarray]:
    """Compare the shading of the first views with the truth, both averaged over noise.

    Parameters
    ----------
    photos : PhotoSet
    shading : Path
        Folder of EXRs, of any unit.

    Returns
    -------
    true : ndarray, shape (n,)
        True shading, green.
    error : ndarray, shape (n, 3)
        Logarithms of found over true shading, less their median.
    """
    true, errors = [], []
    for file in sorted(shading.glob("*.exr"))[:SHARED]:
        albedo = photos.true_albedo(file.stem).astype(np.float32)
        photo, found = read_photo(photos.photos / f"{file.stem}.png"), read_exr(file)
        known = (albedo > 0).all(axis=2) & (photo > 0).all(axis=2) & (found > 0).all(axis=2)
        shown = np.where(known[..., None], photo / np.where(albedo > 0, albedo, 1), 1)
        ratio = np.log(np.where(known[..., None], found, 1) / shown)
        errors.append(smooth_inside(ratio, known, NOISE_PX)[known])
        true.append(smooth_inside(shown[..., 1:2], known, NOISE_PX)[known][:, 0])
    error = np.concatenate(errors)
    return np.concatenate(true), error - np.median(error, axis=0)


def by_brightness(true: np.ndarray, error: np.ndarray) -> list[Part]:
    """Divide pixels, (n,) and (n, 3), into equally many from dark to bright."""
    parts = np.array_split(np.argsort(true, kind="stable"), PARTS)
    return [Part(float(true[own[-1]]), error[own].mean(axis=0), error[own].std(axis=0)) for own in parts]


if __name__ == "__main__":
    main()
