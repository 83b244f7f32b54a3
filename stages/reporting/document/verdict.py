"""The verdict: three sentences made from figures."""

from __future__ import annotations

from typing import Any

from stages.reporting.document.told import Told
from stages.reporting.document.wording import counted, percent


def verdict(told: Told) -> list[str]:
    """Say whether the photos found their place, what the surface covers, and what the light explained."""
    return [sentence for sentence in (_placed(told), _covered(told), _explained(told)) if sentence]


def _placed(told: Told) -> str:
    views, left_out = len(told.views), len(told.left_out)
    facts = told.records["sfm"].facts if "sfm" in told.records else {}
    error = facts.get("mean_reprojection_error_px")
    near = f"; their points agree within {error:.2f} pixels" if error is not None else ""
    if "sfm" not in told.records:
        if "render" in told.records:
            return f"{counted(views, 'view was', 'views were')} rendered, and the cameras are exact."
        less = f", {counted(left_out, 'photo is', 'photos are')} not among them" if left_out else ""
        return f"The cameras were given: {counted(views, 'view', 'views')}{less}."
    if not left_out:
        return f"All {views} photos found their place{near}."
    return f"{views} of {views + left_out} photos found their place, {left_out} did not{near}."


def _covered(told: Told) -> str:
    share = told.content["figures"]["mean_coverage"]
    links = sum(pair["links"] for pair in told.content["graph"])
    pixels = sum(view["coverage"] * view["width"] * view["height"] for view in told.views)
    seen = f", and each point of it is in {1 + 2 * links / pixels:.1f} of the views that were compared"
    return f"The surface covers {percent(share)} of the pictures{seen if links and pixels else ''}."


def _explained(told: Told) -> str:
    figures: dict[str, Any] = told.content["figures"]
    light, albedo, photos = (
        figures[name] for name in ("share_of_light", "difference_of_albedo", "difference_of_photos")
    )
    parts = []
    if light is not None:
        parts.append(
            f"of the variation of brightness in the photos, {percent(light)} was light"
            if light > 0
            else "the albedo varies as much as the photos: no light was found that explains them"
        )
    if albedo is not None and photos:
        parts.append(
            f"where two views show the same point, the albedo differs by {percent(albedo, 1)}, the photos by "
            f"{percent(photos, 1)}"
        )
    whole = "; ".join(parts)
    return f"{whole[:1].upper()}{whole[1:]}." if whole else "There is no albedo yet."
