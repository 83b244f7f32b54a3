"""What has to be known before the pictures of two results are compared."""

from __future__ import annotations

from collections.abc import Sequence

from stages.reporting.comparison.paired_views import Side, shift_px
from stages.scene.wording import listed


def remarks(
    a: Side, b: Side, names: Sequence[str], difference: Sequence[float] | None, most_shift_px: float
) -> list[str]:
    """Say where sizes and lenses differ, and what cannot be compared.

    Parameters
    ----------
    a, b : Side
    names : sequence of str
        Of the views that both have.
    difference : sequence of float, or None
        None without a common pixel.
    most_shift_px : float
        Distance of the same point in both above which it is said.
    """
    said = []
    sizes = [sorted({f"{side.cameras[n].width}×{side.cameras[n].height}" for n in names}) for side in (a, b)]
    if sizes[0] != sizes[1]:
        said.append(
            f"Sizes differ: A {listed(sizes[0], 3)}, B {listed(sizes[1], 3)} pixels. The larger one is "
            "reduced to the smaller, by area, before anything is compared; finer detail is not shown."
        )
    apart = max(shift_px(a, b, name) for name in names)
    if apart > most_shift_px:
        said.append(
            f"Lenses differ: the same point is up to {apart:.1f} pixels apart in the two results, and edges "
            "show in the difference for that alone."
        )
    for kind in ("shading", "confidence"):
        lacking = [label for label, side in (("A", a), ("B", b)) if kind not in side.places]
        if lacking:
            said.append(f"No {kind} in {' and '.join(lacking)}: it is not shown.")
    if difference is None:
        said.append("The two have no pixel of surface in common: no scale and no difference is known.")
    return said
