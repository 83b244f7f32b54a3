"""Remarks on what a photo's header says and the decoder does not deliver, and how it was taken."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image, ImageCms

from stages.formats.colour.icc_profiles import read_profile
from stages.formats.colour.rgb_primaries import REC_709
from stages.formats.decoders.pictures import DECODED, DECODING_FAILED
from stages.formats.decoders.png_chunks import chunks_before_pixels
from stages.formats.images.photos import orientation_of
from stages.scene.image_names import CAMERA_RAW, HEIF

SRGB_GAMMA = 1 / 2.2  # as PNG writes it
SRGB_CODING = bytes([1, 13])  # primaries and transfer of PNG's cICP
TRIED = np.array([[[0, 0, 0], [20, 20, 20], [70, 70, 70], [128, 128, 128], [200, 200, 200], [255, 255, 255],
                   [200, 60, 60], [60, 200, 60], [60, 60, 200], [180, 180, 60]]], np.uint8)  # fmt: skip
# Tolerances decide about a remark only, never about a value.
GAMMA_OFF, PRIMARIES_OFF = 0.01, 0.005
NEARLY = 3  # codes: sRGB as several programs round it
EXIF_COLOUR_SPACE, EXIF_INTEROPERABILITY, INTEROPERABILITY_INDEX = 0xA001, 0xA005, 1
EXIF_DETAILS = 0x8769
ADOBE = 2  # as some cameras write into EXIF_COLOUR_SPACE; others write "R03" beside "uncalibrated"
HDR_LINES = (b"EXPOSURE", b"COLORCORR", b"PRIMARIES")
TURNS = {2: "mirrored", 3: "turned by 180°", 4: "mirrored upside down", 5: "mirrored and turned by 90°",
         6: "turned by 90°", 7: "mirrored and turned by 270°", 8: "turned by 270°"}  # fmt: skip


def remarks_on(path: Path, as_stored: bool, with_alpha: bool) -> list[str]:
    """Describe what is not delivered, as in "an embedded profile (Adobe RGB (1998)): taken as sRGB".

    Empty where all is delivered.

    Parameters
    ----------
    path : Path
        A photo that `read_photo` can read.
    as_stored : bool
        Whether it is taken as stored, whatever its orientation tag says.
    with_alpha : bool
        Whether an alpha channel is delivered, as a mask.
    """
    if path.suffix.lower() == ".exr":
        return _on_exr(path, with_alpha)
    if path.suffix.lower() == ".hdr":
        return _on_hdr(path)
    turned = orientation_of(path) if as_stored else 1
    remarks = [f"{TURNS[turned]} by its tag: taken as stored, as COLMAP does"] if turned != 1 else []
    if path.suffix.lower() in HEIF + CAMERA_RAW:
        return remarks
    with Image.open(path, formats=DECODED) as image:
        remarks += _on_colour(image, chunks_before_pixels(path))
        if image.has_transparency_data and not with_alpha:
            remarks.append("an alpha channel: left out")
        frames = _frames_in(image)
        if frames > 1 and image.format != "MPO":  # a telephone's: its first picture is the photo
            remarks.append(f"{frames} pictures in one file: the first is taken")
        if image.mode == "CMYK":
            remarks.append("CMYK: converted without a profile")
    return remarks


def _frames_in(image: Image.Image) -> int:
    """Count the pictures of a file; one where the directory of the others cannot be read."""
    try:
        return getattr(image, "n_frames", 1)
    except DECODING_FAILED:
        return 1


def _on_colour(image: Image.Image, chunks: Mapping[bytes, bytes]) -> list[str]:
    """What the header says of colours, the strongest word first, as PNG has it."""
    coding = chunks.get(b"cICP")
    if coding is not None:
        return [] if coding[:2] == SRGB_CODING else [f"a coding of {list(coding)} (cICP): taken as sRGB"]
    profile = image.info.get("icc_profile")
    if profile:
        known = read_profile(profile) is not None or _is_srgb(profile)
        return [] if known else [f"an embedded profile ({_name_of_profile(profile)}): taken as sRGB"]
    if b"sRGB" in chunks:
        return []
    if abs(image.info.get("gamma", SRGB_GAMMA) - SRGB_GAMMA) > GAMMA_OFF:
        return [f"a gamma of {image.info['gamma']:.3g}: taken as sRGB"]
    if b"cHRM" in chunks:
        white_first = np.frombuffer(chunks[b"cHRM"], ">u4")[:8] / 1e5
        if not np.allclose(np.roll(white_first, -2), REC_709, atol=PRIMARIES_OFF):
            return ["other primaries than sRGB's (cHRM): taken as sRGB's"]
    return ["Adobe RGB by its EXIF data: taken as sRGB"] if _is_adobe_by_exif(image) else []


def _is_srgb(profile: bytes) -> bool:
    """Whether colours mean in the profile what they mean in sRGB, whatever it is called."""
    try:
        embedded = ImageCms.ImageCmsProfile(BytesIO(profile))
        mode = "L" if embedded.profile.xcolor_space.strip() == "GRAY" else "RGB"
        tried = Image.fromarray(TRIED).convert(mode)
        meant = ImageCms.profileToProfile(tried, embedded, ImageCms.createProfile("sRGB"), outputMode="RGB")
    except (ImageCms.PyCMSError, *DECODING_FAILED):
        return False
    off = np.asarray(meant, np.int16) - np.asarray(tried.convert("RGB"), np.int16)
    return int(np.abs(off).max()) <= NEARLY


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


def _on_hdr(path: Path) -> list[str]:
    with path.open("rb") as file:
        head = file.read(65536).split(b"\n\n", 1)[0].splitlines()
    said = [line.decode("ascii", "replace") for line in head if line.startswith(HDR_LINES)]
    return [f"{line.strip()}: left out" for line in said]


def _on_exr(path: Path, with_alpha: bool) -> list[str]:
    with OpenEXR.File(str(path), header_only=True) as file:  # which empties its header when it is closed
        header, parts = dict(file.header()), len(file.parts)
    remarks = []
    if parts > 1:
        remarks.append(f"{parts} parts in one file: the first is taken")
    primaries = header.get("chromaticities")
    if primaries is not None and not np.allclose(np.ravel(primaries)[:8], REC_709, atol=PRIMARIES_OFF):
        remarks.append("other primaries than sRGB's (chromaticities): taken as sRGB's")
    if not with_alpha and any(channel.name == "A" for channel in header["channels"]):
        remarks.append("an alpha channel: left out")
    if not np.array_equal(np.ravel(header["dataWindow"]), np.ravel(header["displayWindow"])):
        remarks.append("a data window other than its display window: the data window is taken")
    return remarks
