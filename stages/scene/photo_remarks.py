"""What the header of a photo says and the decoder does not deliver, in words, with what was done about it."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image, ImageCms

from stages.scene.photos import DECODING_FAILED, orientation_of

SRGB_GAMMA = 1 / 2.2  # as PNG writes it
EXIF_COLOUR_SPACE, EXIF_INTEROPERABILITY, INTEROPERABILITY_INDEX = 0xA001, 0xA005, 1
EXIF_DETAILS = 0x8769
ADOBE = 2  # as some cameras write into EXIF_COLOUR_SPACE; others write "R03" beside "uncalibrated"
REC_709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
TURNS = {2: "mirrored", 3: "turned by 180°", 4: "mirrored upside down", 5: "mirrored and turned by 90°",
         6: "turned by 90°", 7: "mirrored and turned by 270°", 8: "turned by 270°"}  # fmt: skip


def remarks_on(path: Path, as_stored: bool) -> list[str]:
    """Phrases such as "an embedded profile (Adobe RGB (1998)): taken as sRGB", empty where all is delivered.

    Parameters
    ----------
    path : Path
        A photo that `read_photo` can read.
    as_stored : bool
        Whether it is taken as stored, whatever its orientation tag says.
    """
    if path.suffix.lower() == ".exr":
        return _on_exr(path)
    if path.suffix.lower() == ".hdr":
        return []
    turned = orientation_of(path) if as_stored else 1
    remarks = [f"{TURNS[turned]} by its tag: taken as stored, as COLMAP does"] if turned != 1 else []
    with Image.open(path) as image:
        remarks += _on_colour(image)
        if image.has_transparency_data:
            remarks.append("an alpha channel: left out")
        if (frames := getattr(image, "n_frames", 1)) > 1:
            remarks.append(f"{frames} pictures in one file: the first is taken")
        if image.mode == "CMYK":
            remarks.append("CMYK: converted without a profile")
    return remarks


def _on_colour(image: Image.Image) -> list[str]:
    profile = image.info.get("icc_profile")
    if profile:
        name = _name_of_profile(profile)
        return [] if "srgb" in name.lower() else [f"an embedded profile ({name}): taken as sRGB"]
    if "srgb" not in image.info and abs(image.info.get("gamma", SRGB_GAMMA) - SRGB_GAMMA) > 0.01:
        return [f"a gamma of {image.info['gamma']:.3g}: taken as sRGB"]
    return ["Adobe RGB by its EXIF data: taken as sRGB"] if _is_adobe_by_exif(image) else []


def _name_of_profile(profile: bytes) -> str:
    try:
        name = ImageCms.getProfileDescription(ImageCms.ImageCmsProfile(BytesIO(profile)))
    except (ImageCms.PyCMSError, *DECODING_FAILED):
        return "which cannot be read"
    return " ".join(name.split())[:60] or "without a name"


def _is_adobe_by_exif(image: Image.Image) -> bool:
    try:
        exif = Image.Image.getexif(image)
        space = exif.get_ifd(EXIF_DETAILS).get(EXIF_COLOUR_SPACE)
        index = exif.get_ifd(EXIF_INTEROPERABILITY).get(INTEROPERABILITY_INDEX, "")
    except (KeyError, *DECODING_FAILED):
        return False
    return space == ADOBE or str(index).startswith("R03")


def _on_exr(path: Path) -> list[str]:
    with OpenEXR.File(str(path), header_only=True) as file:  # which empties its header when it is closed
        header, parts = dict(file.header()), len(file.parts)
    remarks = []
    if parts > 1:
        remarks.append(f"{parts} parts in one file: the first is taken")
    primaries = header.get("chromaticities")
    if primaries is not None and not np.allclose(np.ravel(primaries)[:8], REC_709, atol=0.005):
        remarks.append("other primaries than sRGB's (chromaticities): taken as sRGB's")
    if any(channel.name == "A" for channel in header["channels"]):
        remarks.append("an alpha channel: left out")
    if not np.array_equal(np.ravel(header["dataWindow"]), np.ravel(header["displayWindow"])):
        remarks.append("a data window other than its display window: the data window is taken")
    return remarks
