"""Exposure of a photo, as its EXIF data say."""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, isfinite, log
from pathlib import Path

from stages.formats.decoders.pictures import EXIF_DIRECTORIES, exif_directory, exif_of

EXPOSURE_TIME, APERTURE, SENSITIVITY = 0x829A, 0x829D, 0x8827  # s, f-number, ISO


def exposure_of(path: Path) -> float | None:
    """Compute the exposure t S / N² of a photo: seconds by ISO over the f-number's square.

    None where one of them is missing, zero, or no number.
    """
    details = exif_directory(exif_of(path), EXIF_DIRECTORIES[0])
    time, aperture, sensitivity = (
        _number(details.get(tag)) for tag in (EXPOSURE_TIME, APERTURE, SENSITIVITY)
    )
    opening = aperture * aperture  # 0 or infinite for numbers that no lens has
    exposure = time * sensitivity / opening if opening > 0 else 0.0
    return exposure if isfinite(exposure) and exposure > 0 else None


def relative_exposures(exposures: Mapping[str, float | None]) -> dict[str, float]:
    """Divide exposures by their geometric mean; nothing where some are not known, or all are alike."""
    known = {name: log(exposure) for name, exposure in exposures.items() if exposure is not None}
    if len(known) < len(exposures) or len(set(known.values())) < 2:
        return {}
    middle = sum(known.values()) / len(known)
    return {name: exp(value - middle) for name, value in known.items()}


def range_ev(exposures: Mapping[str, float]) -> float:
    """Compute how far the largest exposure is from the smallest, in stops."""
    return log(max(exposures.values()) / min(exposures.values()), 2)


def _number(value: object) -> float:
    """Read a positive number, or the first of several; 0 for anything else."""
    first = value[0] if isinstance(value, tuple) and value else value
    try:
        number = float(first)  # type: ignore[arg-type]
    except (TypeError, ValueError, ArithmeticError):
        return 0.0
    return number if isfinite(number) and number > 0 else 0.0
