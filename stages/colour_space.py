"""The EXRs of `output/` in another colour space, where one is asked for. The cache stays linear sRGB."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pipeline import Artefact, Job, Settings, Stage, setting

if TYPE_CHECKING:
    import numpy as np


class ColourSpaceSettings(Settings):
    """Settings of the `colour_space` stage, which is part of a run where another space is asked for."""

    exr: Literal["srgb-linear", "acescg"] = setting(
        "srgb-linear",
        "Primaries of the EXRs of albedo, shading, light, textures and relit views, as their headers say: "
        "those of sRGB, or ACEScg (AP1).",
    )


def run(job: Job[ColourSpaceSettings]) -> None:
    """Convert the colours of every EXR, and copy all else."""
    converted = 0
    for name, source in job.inputs.items():
        files = sorted(path.relative_to(source) for path in source.rglob("*") if path.is_file())
        with job.progress(name, len(files)) as step:
            for _ in job.executor.map(lambda file, name=name: _convert(job, name, file), files):
                step()
        converted += sum(file.suffix == ".exr" for file in files)
    job.note(converted=converted)


def _convert(job: Job[ColourSpaceSettings], name: str, file: Path) -> None:
    """Write one file of an artefact in the other colour space."""
    from stages.formats.colour.rgb_primaries import ACESCG
    from stages.formats.images.exr import read_exr, write_exr

    source, target = job.inputs[name] / file, job.outputs[f"{name}_converted"] / file
    target.parent.mkdir(parents=True, exist_ok=True)
    image = read_exr(source) if file.suffix == ".exr" else None
    if image is None or image.ndim == 2:  # pictures have the colours of screens; confidence has none
        shutil.copyfile(source, target)
        return
    beside = _albedo_of(job, name, file)
    converted = _colours(image) if beside is None else _shading(image, read_exr(beside))
    write_exr(target, converted, primaries=ACESCG)


def _albedo_of(job: Job[ColourSpaceSettings], name: str, file: Path) -> Path | None:
    """Find the albedo that a shading belongs to; None of what is no shading."""
    if name == "shading":
        return job.inputs["albedo"] / file
    is_texture = name == "textured_model" and file.name == "shading.exr"
    return (job.inputs[name] / file).with_name("albedo.exr") if is_texture else None


def _colours(image: np.ndarray) -> np.ndarray:
    """Convert linear sRGB to ACEScg, (h, w, 3)."""
    from stages.formats.colour.rgb_primaries import ACESCG, REC_709, conversion

    return (image @ conversion(REC_709, ACESCG).T).astype("float32")


def _shading(shading: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """Convert a shading such that albedo times shading is the photo in the other colour space as well."""
    import numpy as np

    photo, other = _colours(albedo * shading), _colours(albedo)
    known = other > 0
    return np.where(known, photo / np.where(known, other, 1), _colours(shading)).astype(np.float32)


CONVERTED = ("albedo", "shading", "albedo_tv", "light_pictures", "albedo_full", "textured_model", "relit")
PLACES = {"light_pictures": "environment", "textured_model": "model"}


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['converted']} EXRs converted"


COLOUR_SPACE = Stage(
    name="colour_space",
    version=1,
    about="The EXRs in another colour space, where one is asked for.",
    settings=ColourSpaceSettings,
    takes=CONVERTED,
    gives=tuple(
        Artefact(f"{name}_converted", f"{name} in that colour space", output=PLACES.get(name, name))
        for name in CONVERTED
    ),
    run=run,
    tools=("numpy", "openexr"),
    saves_memory="give --threads 1: one picture at a time",
    found=in_words,
)
