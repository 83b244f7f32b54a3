"""The content of the report: pictures of every view, figures, the light, a model; the page comes after it."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from pipeline import Artefact, Job, Stage
from stages.reporting.settings import ReportSettings
from stages.scene.distributions import OPEN3D, PICTURES
from stages.scene.memory_of_views import FEWER_PIXELS

if TYPE_CHECKING:
    import numpy as np

    from stages.reporting.content.link_samples import LinkValues
    from stages.reporting.content.opened_view import OpenedView, ShownView
    from stages.reporting.content.textured_surface import TexturedSurface
    from stages.reporting.content.vertex_maps import SmallSurface
    from stages.reporting.content.view_figures import SampledView
    from stages.scene.cameras import Camera

PER_VIEW = ("linear", "depth", "normal", "albedo", "shading", "confidence", "relit")
NEEDED = ("linear", "cameras")  # without them there is nothing to show

Made = TypeVar("Made")


def run(job: Job[ReportSettings]) -> None:
    """Choose a size at which all pictures fit, make them, and gather what else the page tells."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.reporting.content.opened_view import OpenedView
    from stages.reporting.parts import write_content
    from stages.solvers.kernels.threading_layer import use_threads

    use_threads(job.threads)
    cameras = read_cameras(job.inputs["cameras"])
    with job.progress("report", len(cameras) + 1) as step:
        links, graph = _links(job, cameras)
        small = _surface(job, cameras)
        step()
        side, places = _side(job, cameras), _places(job, cameras)
        views, sampled, compared = [], [], []
        for number, shown in enumerate(
            _of_views(job, cameras, side, OpenedView.shown, links, small is not None)
        ):
            views.append(_kept(job, number, cameras[number], shown, places[number]))
            sampled.append(shown.figures)
            if small is not None and shown.maps is not None:
                compared.append(small.add(shown.maps, job.settings.surface))
            step()
    _compare_albedo(views, compared, job.settings)
    content = {
        "longest_side_px": side,
        "views": views,
        "graph": graph,
        "figures": _figures(sampled, links, job.settings),
        "lights": _lights(job, cameras),
        "surface": _write_surface(job, cameras, small),
        "sides": _sides(job, cameras, small),
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
    from stages.reporting.content.opened_view import OpenedView
    from stages.reporting.content.picture_size import side_that_fits

    how = job.settings.pictures
    some = cameras[:: max(1, -(-len(cameras) // how.tried_views))]
    tried = list(_of_views(job, some, how.largest_px, OpenedView.pixels))
    return side_that_fits(tried, len(cameras), how)


def _of_views(
    job: Job[ReportSettings],
    cameras: list[Camera],
    side: int,
    make: Callable[[OpenedView], Made],
    links: LinkValues | None = None,
    with_surface: bool = False,
) -> Iterator[Made]:
    """Open as many views at once as there are threads, and yield what is made of them, in order."""
    from stages.reporting.content.opened_view import OpenedView

    def made(number: int) -> Made:
        """Read a view's maps one after the other, each reduced at once."""
        keep = None if links is None else partial(links.add, number)
        view = OpenedView(cameras[number], job.inputs, job.settings, side, keep, with_surface)
        for kind in PER_VIEW:
            if kind in job.inputs:
                view.read(kind)
        return make(view)

    ahead: deque[Future[Made]] = deque()
    for number in range(len(cameras)):
        ahead.append(job.executor.submit(made, number))
        if len(ahead) > job.threads:  # the next ones are opened while this one is kept
            yield ahead.popleft().result()
    while ahead:
        yield ahead.popleft().result()


def _kept(
    job: Job[ReportSettings],
    number: int,
    camera: Camera,
    shown: ShownView,
    place: list[float],
) -> dict[str, Any]:
    """Write a view's pictures, and describe it."""
    from stages.reporting.parts import picture_file, thumbnail_file, write_file

    folder = job.outputs["report_content"]
    for kind, data in shown.pictures.items():
        write_file(folder, picture_file(number, kind), data)
    for kind, data in shown.thumbnails.items():
        write_file(folder, thumbnail_file(number, kind), data)
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


def _compare_albedo(
    views: list[dict[str, Any]], compared: list[np.ndarray], settings: ReportSettings
) -> None:
    """Add to each view's description how its albedo differs from the others', in stops, or None."""
    from stages.reporting.content.view_brightness import brightness_beside_others

    found = brightness_beside_others(compared, settings.surface.fewest_compared) or [None] * len(views)
    for view, beside in zip(views, found, strict=True):
        view["albedo_stops"] = beside and beside.stops
        view["albedo_spread_stops"] = beside and beside.spread_stops


def _sides(
    job: Job[ReportSettings], cameras: list[Camera], small: SmallSurface | None
) -> dict[str, Any] | None:
    """Find from which side no view shows the surface."""
    import numpy as np

    from stages.reporting.content.sides_seen import SidesSeen
    from stages.scene.upright import upright_from_world

    if small is None:
        return None
    centres = np.stack([camera.centre_in_world for camera in cameras])
    upright = upright_from_world(cameras, job.settings.upright_within_deg)
    return SidesSeen.of(small.surface, centres, upright).as_json()


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
    """Write the model for the page, textured where it is, and describe it and the cameras in its axes."""
    from stages.reporting.content.page_scene import PageScene
    from stages.reporting.content.vertex_maps import colours_as_bytes
    from stages.reporting.parts import SURFACE, write_file
    from stages.scene.upright import gltf_from_world

    if small is None:
        return None
    how, white, textured = job.settings.surface, _white(job), _textured(job)
    shown = textured or small
    mesh = shown.surface
    scene = PageScene.around(mesh.vertices, gltf_from_world(cameras, job.settings.upright_within_deg))
    block = textured.uv_codes().tobytes() if textured else colours_as_bytes(small, white, how)
    write_file(job.outputs["report_content"], SURFACE, scene.mesh_as_bytes(mesh, shown.normals, [block]))
    textures = _write_textures(job, textured, white) if textured else []
    seen = float((small.sums.weight > 0).mean())
    return scene.as_json(mesh, cameras) | {"textures": textures, "seen": seen}


def _textured(job: Job[ReportSettings]) -> TexturedSurface | None:
    """Read the textured model, where there is one that a page can show."""
    from stages.reporting.content.textured_surface import TexturedSurface

    if "textured_model" not in job.inputs:
        return None
    return TexturedSurface.of(job.inputs["textured_model"], job.settings.surface)


def _write_textures(job: Job[ReportSettings], textured: TexturedSurface, white: float) -> list[int]:
    """Write the textures' pictures; returns how many faces each texture has."""
    from stages.reporting.content.picture_size import encode_webp
    from stages.reporting.parts import texture_file, write_file

    how = job.settings
    for number, pictures in enumerate(textured.pictures(white, how.surface)):
        for kind, pixels in pictures.items():
            data = encode_webp(pixels, None, how.pictures)
            write_file(job.outputs["report_content"], texture_file(number, kind), data)
    return textured.faces_of.tolist()


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
    version=7,
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
        "textured_model",
    ),
    gives=(Artefact("report_content", "pictures, figures and a model: what output/report.html shows"),),
    run=run,
    tools=("numpy", "scipy", "numba", "fast-simplification", *OPEN3D, *PICTURES),
    saves_memory=FEWER_PIXELS,
    found=in_words,
)
