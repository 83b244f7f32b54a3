"""Results in common formats: PNGs at one scale, a COLMAP workspace, `transforms.json`, a contact sheet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Settings, Stage, group, json_text, setting
from stages.scene.distributions import PICTURES, PYCOLMAP
from stages.scene.memory_of_views import FEWER_PIXELS

if TYPE_CHECKING:
    import numpy as np

    from stages.scene.cameras import Camera


class PictureSettings(Settings):
    """Settings of the conversion of maps to pictures, apart from `white_quantile`."""

    white_samples: int = setting(
        200_000, "Values per view, at most, that enter the quantile.", unit="values", ge=100
    )
    dark_median: float = setting(
        0.003,
        "Pictures whose median is darker are reported as black: it is below 10 of 255 in sRGB.",
        unit="of white",
        ge=0,
        le=1,
    )
    sheet_white: float = setting(
        3.0,
        "White of the contact sheet's photos as a multiple of their mean, where they are linear and "
        "exceed 1.",
        unit="mean values",
        gt=0,
    )


class ExportSettings(Settings):
    """Settings of the `export` stage."""

    white_quantile: float = setting(
        0.995,
        "PNG white is this quantile of all views' values, one scale for all: a few highlights may clip, but "
        "views remain comparable.",
        gt=0,
        le=1,
    )
    sheet_width_px: int = setting(320, "Width of a picture in the contact sheet.", unit="px", ge=32, le=2048)
    sheet_views: int = setting(16, "Views in the contact sheet, evenly chosen.", ge=1, le=200)
    pictures: PictureSettings = group(PictureSettings, "Conversion of maps to pictures.")


def common_white(
    folder: Path, masks: Path, names: list[str], settings: ExportSettings
) -> tuple[float, float]:
    """Find the linear value that becomes PNG white, and the median, over masked pixels of all views' EXRs."""
    import numpy as np

    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import read_mask

    samples = []
    for name in names:
        values = read_exr(folder / f"{name}.exr")[read_mask(masks / f"{name}.png")].max(axis=1)
        samples.append(values[:: max(1, len(values) // settings.pictures.white_samples)])
    white, middle = np.quantile(np.concatenate(samples), [settings.white_quantile, 0.5])
    return (float(white) if white > 0 else 1.0), float(middle)


def warn_of_dark_pictures(job: Job[ExportSettings], kind: str, white: float, middle: float) -> None:
    """Warn where the median of pictures is so far below white that they look black."""
    if middle < job.settings.pictures.dark_median * white:
        job.warn(
            f"The PNGs of {kind} look black: white stands for {white:.3g}, and half of all pixels lie below "
            f"{middle:.3g}. Lower export.white_quantile ({job.settings.white_quantile:g}), or mask what is "
            "so bright; the EXRs are as they should be."
        )


def run(job: Job[ExportSettings]) -> None:
    """Encode the maps, view by view."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.cameras.transforms_json import write_transforms
    from stages.formats.images.contact_sheet import contact_sheet
    from stages.formats.images.photos import write_png8

    settings = job.settings
    cameras = read_cameras(job.inputs["cameras"])
    names = [camera.name for camera in cameras]
    whites = {}
    for kind in ("albedo", "shading"):
        found = common_white(job.inputs[kind], job.inputs["mask"], names, settings)
        whites[kind] = found[0]
        warn_of_dark_pictures(job, kind, *found)
    in_sheet = set(evenly(names, settings.sheet_views))

    def export_view(camera: Camera) -> list[np.ndarray] | None:
        albedo, shading = (export_maps(job, kind, camera.name, whites[kind]) for kind in whites)
        export_dense_view(job, camera, albedo)
        return sheet_row(job, camera, albedo, shading) if camera.name in in_sheet else None

    rows = {}
    with job.progress("pictures", len(cameras)) as step:
        for name, row in zip(names, job.executor.map(export_view, cameras), strict=True):
            if row is not None:
                rows[name] = row
            step()
    write_png8(
        job.outputs["contact_sheet"],
        contact_sheet(rows, ["photo", "albedo", "shading", "normals (world axes)"], settings.sheet_width_px),
    )
    write_dense_model(job, cameras)
    write_transforms(job.outputs["transforms"], cameras, "dense/images/{name}.png", "mask/{name}.png")
    write_scales(job.outputs["scales"], whites)
    job.note(png_white={kind: float(f"{white:.6g}") for kind, white in whites.items()})


def evenly(names: list[str], count: int) -> list[str]:
    """Choose at most `count` of the names, evenly spaced, the first and the last among them."""
    if len(names) <= count:
        return names
    last = len(names) - 1
    return [names[round(index * last / max(count - 1, 1))] for index in range(count)]


def export_maps(job: Job[ExportSettings], kind: str, name: str, white: float) -> np.ndarray:
    """Write one map as 16-bit PNG, and return it scaled so that white is 1, linear."""
    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import write_png_srgb16

    scaled = read_exr(job.inputs[kind] / f"{name}.exr") / white
    write_png_srgb16(job.outputs[f"{kind}_png"] / f"{name}.png", scaled)
    return scaled


def export_dense_view(job: Job[ExportSettings], camera: Camera, albedo: np.ndarray) -> None:
    """Write one view of the albedo workspace: its image, and the mesh's depth and normals as COLMAP maps.

    From these maps COLMAP's `stereo_fusion` makes a point cloud in albedo colours.
    """
    from stages.formats.colmap.depth_maps import write_map
    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import write_png_srgb8
    from stages.scene.cameras import normals_in_cam

    dense, file = job.outputs["dense"], f"{camera.name}.png.geometric.bin"
    write_png_srgb8(dense / "images" / f"{camera.name}.png", albedo)
    write_map(dense / "stereo/depth_maps" / file, read_exr(job.inputs["depth"] / f"{camera.name}.exr"))
    normals = normals_in_cam(camera, read_exr(job.inputs["normal"] / f"{camera.name}.exr"))
    write_map(dense / "stereo/normal_maps" / file, normals)


def sheet_row(
    job: Job[ExportSettings], camera: Camera, albedo: np.ndarray, shading: np.ndarray
) -> list[np.ndarray]:
    """Convert photo, albedo, shading and normals of one view to 8-bit pictures."""
    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import encode_srgb8, read_mask
    from stages.formats.images.resize import reduce_by_area

    photo = reduce_by_area(read_exr(job.inputs["linear"] / f"{camera.name}.exr"), camera.shape)
    mask = read_mask(job.inputs["mask"] / f"{camera.name}.png")
    normals = read_exr(job.inputs["normal"] / f"{camera.name}.exr")
    normal_colours = ((normals * 0.5 + 0.5) * 255 * mask[..., None]).round().astype("uint8")
    times = job.settings.pictures.sheet_white
    bright = max(float(photo[mask].max(axis=1).mean()) * times, 1e-6) if photo.max() > 1 else 1.0
    return [encode_srgb8(photo / bright), encode_srgb8(albedo), encode_srgb8(shading), normal_colours]


def write_dense_model(job: Job[ExportSettings], cameras: list[Camera]) -> None:
    """Write the sparse model and settings that make the albedo images a COLMAP workspace."""
    from stages.formats.colmap.dense_workspace import write_stereo_settings
    from stages.formats.colmap.model import pinhole_model, read_model, write_model

    model = pinhole_model(cameras, read_model(job.inputs["workspace"] / "sparse"))
    write_model(model, job.outputs["dense"] / "sparse")
    write_stereo_settings(job.outputs["dense"], [f"{camera.name}.png" for camera in cameras])


def write_scales(path: Path, whites: dict[str, float]) -> None:
    """Write the scale that converts PNG values to EXR values."""

    about = "PNG white (sRGB-decoded 1.0) stands for this value in the EXR, the same for all views"
    path.write_text(json_text({"about": about, "png_white": whites}, indent=1) + "\n", encoding="utf-8")


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"white of the PNGs is an albedo of {facts['png_white']['albedo']:.3g}"


EXPORT = Stage(
    name="export",
    formerly=("deliver",),
    version=3,
    about="PNGs at one common scale, a COLMAP workspace of albedo maps, cameras for NeRF, a contact sheet.",
    settings=ExportSettings,
    takes=("linear", "albedo", "shading", "normal", "mask", "depth", "cameras", "workspace"),
    gives=(
        Artefact("albedo_png", "albedo per view, 16-bit sRGB PNG", output="albedo"),
        Artefact("shading_png", "shading per view, 16-bit sRGB PNG", output="shading"),
        Artefact("scales", "what PNG white stands for", file="png_scale.json", output="png_scale.json"),
        Artefact("dense", "COLMAP workspace whose images are the albedo maps", output="dense"),
        Artefact(
            "transforms",
            "the cameras and albedo images as nerfstudio takes them",
            file="transforms.json",
            output="transforms.json",
        ),
        Artefact(
            "contact_sheet",
            "photo, albedo, shading, normals",
            file="contact_sheet.png",
            output="contact_sheet.png",
        ),
    ),
    run=run,
    tools=("numpy", *PYCOLMAP, *PICTURES),
    saves_memory=FEWER_PIXELS,
    found=in_words,
)
