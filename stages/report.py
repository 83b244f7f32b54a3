"""The content of the report: pictures of every view, figures, the light, a model; the page comes after it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from pipeline import Artefact, Job, Stage
from stages.reporting.settings import ReportSettings
from stages.scene.distributions import OPEN3D, PICTURES
from stages.scene.memory_of_views import FEWER_PIXELS

if TYPE_CHECKING:
    from stages.reporting.content.link_samples import LinkValues
    from stages.reporting.content.opened_view import OpenedView
    from stages.reporting.content.vertex_maps import SmallSurface
    from stages.reporting.content.view_figures import SampledView
    from stages.scene.cameras import Camera
    from stages.texturing.gathering import ViewMaps

PER_VIEW = ("linear", "depth", "normal", "albedo", "shading", "confidence", "relit")
NEEDED = ("linear", "cameras")  # without them there is nothing to show

Made = TypeVar("Made")


@dataclass(frozen=True, eq=False)
class ShownView:
    """A view, reduced: its pictures, figures, and what it tells of the surface.

    Attributes
    ----------
    pictures : dict of str to bytes
        WebP by kind.
    thumbnail : bytes
    figures : SampledView
    depth_range : tuple of 2 floats, or None
    maps : ViewMaps or None
    """

    pictures: dict[str, bytes]
    thumbnail: bytes
    figures: SampledView
    depth_range: tuple[float, float] | None
    maps: ViewMaps | None


def run(job: Job[ReportSettings]) -> None:
    """Choose a size at which all pictures fit, make them, and gather what else the page tells."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.reporting.parts import write_content
    from stages.solvers.kernels.threading_layer import use_threads

    use_threads(job.threads)
    cameras = read_cameras(job.inputs["cameras"])
    with job.progress("report", len(cameras) + 1) as step:
        links, graph = _links(job, cameras)
        small = _surface(job, cameras)
        step()
        side, places = _side(job, cameras), _places(job, cameras)
        views, sampled = [], []
        for number, shown in enumerate(_of_views(job, cameras, side, _shown, links, small is not None)):
            views.append(_kept(job, number, cameras[number], shown, small, places[number]))
            sampled.append(shown.figures)
            step()
    content = {
        "longest_side_px": side,
        "views": views,
        "graph": graph,
        "figures": _figures(sampled, links, job.settings),
        "lights": _lights(job, cameras),
        "surface": _write_surface(job, cameras, small),
        "energy": _energy(job),
        **_remark_bounds(job.settings),
    }
    write_content(job.outputs["report_content"], content)
    job.note(longest_side_px=side, **content["figures"])


def _places(job: Job[ReportSettings], cameras: list[Camera]) -> list[list[float]]:
    """Place the cameras as seen from above."""
    from stages.scene.upright import upright_from_world

    upright = upright_from_world(cameras, job.settings.upright_within_deg)
    return [(upright @ camera.centre_in_world)[:2].tolist() for camera in cameras]


def _links(job: Job[ReportSettings], cameras: list[Camera]) -> tuple[LinkValues, list[dict[str, Any]]]:
    """Sample corresponding pixels; none where there are no correspondences."""
    from stages.formats.artefacts.correspondence_files import CorrespondenceFiles
    from stages.reporting.content.link_samples import LinkValues, graph_as_json, sampled_links

    if "correspondences" not in job.inputs:
        return LinkValues([]), []
    files = CorrespondenceFiles.of(job.inputs["correspondences"], cameras)
    return LinkValues(sampled_links(files, job.settings.figures)), graph_as_json(files)


def _surface(job: Job[ReportSettings], cameras: list[Camera]) -> SmallSurface | None:
    """Decimate the mesh, where it and its albedo are there."""
    from stages.formats.meshes.triangle_meshes import read_mesh
    from stages.reporting.content.vertex_maps import SmallSurface

    if not {"mesh", "mask", "depth", "albedo", "shading"} <= job.inputs.keys():
        return None
    return SmallSurface.of(read_mesh(job.inputs["mesh"]), cameras, job.settings.surface)


def _side(job: Job[ReportSettings], cameras: list[Camera]) -> int:
    """Choose the longest side of pictures, by the bytes that those of some views take."""
    import numpy as np

    from stages.reporting.content.opened_view import OpenedView
    from stages.reporting.content.picture_size import encode_webp, longest_side, reduced_picture

    how = job.settings.pictures
    step = max(1, -(-len(cameras) // how.tried_views))
    tried = list(_of_views(job, cameras[::step], how.largest_px, OpenedView.pixels))

    def bytes_at(side: int) -> float:
        taken = 0
        for pixels, visible in (picture for view in tried for picture in view.values()):
            shown = None if visible is None else reduced_picture(visible.astype(np.uint8), side) > 0
            taken += len(encode_webp(reduced_picture(pixels, side), shown, how.quality))
        return taken / len(tried) * len(cameras)

    return longest_side(how.largest_px, bytes_at, how.megabytes * 1e6)


def _of_views(
    job: Job[ReportSettings],
    cameras: list[Camera],
    side: int,
    make: Callable[[OpenedView], Made],
    links: LinkValues | None = None,
    with_surface: bool = False,
) -> Iterator[Made]:
    """Open the views in batches of as many as there are threads, and yield what is made of them, in order."""
    from stages.reporting.content.opened_view import OpenedView

    def made(number: int) -> Made:
        """Read a view's maps one after the other, each reduced at once."""
        keep = None if links is None else partial(links.add, number)
        view = OpenedView(cameras[number], job.inputs, job.settings, side, keep, with_surface)
        for kind in PER_VIEW:
            if kind in job.inputs:
                view.read(kind)
        return make(view)

    for start in range(0, len(cameras), job.threads):
        yield from job.executor.map(made, range(len(cameras))[start : start + job.threads])


def _shown(view: OpenedView) -> ShownView:
    """Make what the page shows of a view."""
    return ShownView(
        view.pictures(), view.thumbnail(), view.sampled(), view.depth_range, view.maps_for_surface()
    )


def _kept(
    job: Job[ReportSettings],
    number: int,
    camera: Camera,
    shown: ShownView,
    small: SmallSurface | None,
    place: list[float],
) -> dict[str, Any]:
    """Write a view's pictures, add it to the surface, and describe it."""
    from stages.reporting.parts import picture_file, thumbnail_file, write_file

    folder = job.outputs["report_content"]
    for kind, data in shown.pictures.items():
        write_file(folder, picture_file(number, kind), data)
    write_file(folder, thumbnail_file(number), shown.thumbnail)
    if small is not None and shown.maps is not None:
        small.add(shown.maps, job.settings.surface)
    return {
        "name": camera.name,
        "width": camera.width,
        "height": camera.height,
        "focal_px": camera.focal_px,
        "place": place,
        "kinds": list(shown.pictures),
        "depth_range": shown.depth_range,
        **shown.figures.as_json(job.settings.figures.confident),
    }


def _figures(sampled: list[SampledView], links: LinkValues, settings: ReportSettings) -> dict[str, Any]:
    """Compute the figures of all views together."""
    import numpy as np

    from pipeline import finite_or_null
    from stages.reporting.content.view_figures import share_of_light

    return finite_or_null(
        {
            "mean_coverage": float(np.mean([view.coverage for view in sampled])),
            "share_of_light": share_of_light(sampled, settings.figures.log_offset),
            "difference_of_photos": links.difference("photo"),
            "difference_of_albedo": links.difference("albedo"),
        }
    )


def _lights(job: Job[ReportSettings], cameras: list[Camera]) -> dict[str, Any]:
    """Write pictures of the lights, and describe these and the gains of the views."""
    from stages.formats.artefacts.light_npz import read_light
    from stages.reporting.content.light_pictures import write_lights

    if "found_light" not in job.inputs or "light_pictures" not in job.inputs:
        return {"shown": [], "gains": []}
    light = read_light(job.inputs["found_light"]).around
    folders = job.inputs["light_pictures"], job.outputs["report_content"]
    return write_lights(light, cameras, *folders, job.settings.pictures)


def _write_surface(
    job: Job[ReportSettings], cameras: list[Camera], small: SmallSurface | None
) -> dict[str, Any] | None:
    """Write the model for the page, and describe it and the cameras in its axes."""
    from stages.reporting.content.vertex_maps import as_bytes, frusta
    from stages.reporting.parts import SURFACE, write_file
    from stages.scene.upright import gltf_from_world

    if small is None:
        return None
    scene_from_world = gltf_from_world(cameras, job.settings.upright_within_deg)
    white = _white(job)
    data, about = as_bytes(small, scene_from_world, white, job.settings.surface)
    write_file(job.outputs["report_content"], SURFACE, data)
    return about | {"cameras": frusta(cameras, scene_from_world, small.origin, about)}


def _white(job: Job[ReportSettings]) -> float:
    """Read which albedo is white."""
    from stages.formats.artefacts.png_scale import png_whites

    if "scales" not in job.inputs:
        return 1.0
    return png_whites(job.inputs["scales"])["albedo"]


def _energy(job: Job[ReportSettings]) -> dict[str, Any] | None:
    """Read the energy, without the settings that are in the record."""
    if "energy" not in job.inputs:
        return None
    energy = json.loads(job.inputs["energy"].read_text(encoding="utf-8"))
    return {name: value for name, value in energy.items() if name != "settings"}


def _remark_bounds(settings: ReportSettings) -> dict[str, Any]:
    """Hand the bounds of remarks and the meaning of colours on to the page."""
    return {
        "remarks": settings.remarks.model_dump(mode="json"),
        "confident": settings.figures.confident,
        "residual_stops": settings.pictures.residual_stops,
    }


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    share = facts.get("share_of_light")
    return "" if share is None else f"light is {share:.0%} of the variation of brightness"


REPORT = Stage(
    name="report",
    version=1,
    about="Pictures, figures and a model for the report, which is written from them and all records.",
    settings=ReportSettings,
    takes=(
        "linear",
        "cameras",
        "mask",
        "depth",
        "normal",
        "correspondences",
        "mesh",
        "light_pictures",
        "found_light",
        "shading",
        "albedo",
        "energy",
        "confidence",
        "scales",
        "relit",
    ),
    gives=(Artefact("report_content", "pictures, figures and a model: what output/report.html shows"),),
    run=run,
    tools=("numpy", "scipy", "numba", "fast-simplification", *OPEN3D, *PICTURES),
    saves_memory=FEWER_PIXELS,
    found=in_words,
)
