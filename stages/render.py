"""Instead of photos: a scene of known truth, path-traced from exact cameras (the paper, Figs. 3 to 7)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Stage, UserError, json_text
from stages.scene.distributions import OPEN3D, PICTURES, PYCOLMAP
from stages.synthetic.render_settings import RenderSettings

if TYPE_CHECKING:
    import numpy as np

    from stages.scene.cameras import Camera
    from stages.synthetic.photograph import Noise
    from stages.synthetic.subjects.subject import Subject
    from stages.synthetic.truth import PaintedSurface, Truth


def run(job: Job[RenderSettings]) -> None:
    """Build, pose, photograph and measure; save the images as a pipeline wants them, the truth beside."""
    import numpy as np

    from stages.formats.colmap.model import pinhole_model, write_model
    from stages.formats.meshes.triangle_meshes import write_mesh
    from stages.synthetic.photograph import NoiseTarget, mean_level, photograph
    from stages.synthetic.render import Quality, Scene, use_threads
    from stages.synthetic.staging import (
        cameras_of,
        footprint_of,
        gloss_of,
        light_of,
        metal_of,
        paint_of,
        through_lens,
        with_room_for_paint,
    )
    from stages.synthetic.truth import PaintedSurface

    settings = job.settings
    _require_mitsuba()
    use_threads(job.threads)
    whole = _subject(job)
    cameras = cameras_of(settings, whole)
    footprint = footprint_of(cameras, whole.centre)
    subject = with_room_for_paint(settings, whole, footprint)
    paint, uniform = paint_of(settings, subject, _own_colours(job), footprint)
    gloss = gloss_of(settings, subject, paint, footprint)
    albedo = paint if gloss is None else paint * (1 - gloss.share[:, None]).astype(np.float32)
    metal = np.tile(metal_of(settings, subject)[:, None], 3).astype(np.float32)
    bare = PaintedSurface(subject.surface, metal) if metal.any() else None
    truths = _write_truths(job, PaintedSurface(subject.surface, albedo, uniform), bare, cameras)
    if not any(truth.mask.any() for truth in truths):
        raise UserError(
            f"The subject covers no whole pixel at {settings.width_px} × {settings.height_px}; render larger."
        )
    scene = Scene(subject.surface, paint, light_of(settings, subject, _surroundings(job)), gloss)
    quality = Quality(samples=64, reflections=settings.reflections)
    target = NoiseTarget(settings.noise, mean_level(scene, cameras, [t.mask for t in truths], quality))
    noises = []
    with job.progress("renders", len(cameras)) as step:
        for index, (camera, truth) in enumerate(zip(cameras, truths, strict=True)):
            image, noise = photograph(scene, camera, truth.mask, quality, target, seed=1000 * index)
            noises.append(noise)
            _write_image(job, camera, truth, through_lens(settings, image, truth.mask, index))
            step()
    write_model(pinhole_model(cameras, extension=".exr"), job.outputs["model"])
    write_mesh(job.outputs["true_mesh"], whole.surface)
    (job.outputs["truth"] / "parts.json").write_text(
        json_text({"parts": list(subject.part_names)}) + "\n", encoding="utf-8"
    )
    _note(job, whole, noises)


def _require_mitsuba() -> None:
    from importlib.util import find_spec

    if find_spec("mitsuba") is None or find_spec("skimage") is None:
        raise UserError(
            "Rendering needs Mitsuba and scikit-image, which are not installed; install them with "
            "`sh setup.sh synthetic`, in the folder that holds unshade."
        )


def _subject(job: Job[RenderSettings]) -> Subject:
    """What is rendered: the object that was given, or one of our own."""
    from stages.formats.meshes.mesh_files import read_mesh_file
    from stages.synthetic.subjects.subject import built_subject, mesh_subject

    settings = job.settings
    if "object" not in job.inputs:
        return built_subject(settings.subject, settings.spacing)
    return mesh_subject(read_mesh_file(job.inputs["object"]), settings.object_parts, settings.y_up)


def _own_colours(job: Job[RenderSettings]) -> np.ndarray | None:
    """Those that the object brings, (V, 3); None where the paint is another."""
    from stages.formats.meshes.triangle_meshes import read_vertex_colours

    if job.settings.paint != "vertex":
        return None
    if "object" not in job.inputs:
        raise UserError("render.paint is vertex, but no object was given; give --object FILE.")
    return read_vertex_colours(job.inputs["object"])


def _surroundings(job: Job[RenderSettings]) -> np.ndarray | None:
    """The picture of all directions, (h, 2h, 3), linear; None where the light is another."""
    from stages.formats.images.photos import read_photo

    if job.settings.light != "environment":
        return None
    if "environment" not in job.inputs:
        raise UserError(
            "render.light is environment, but none was given; give --environment FILE (EXR or HDR, all "
            "directions, twice as wide as high)."
        )
    radiance = read_photo(job.inputs["environment"])
    if radiance.shape[1] != 2 * radiance.shape[0]:
        raise UserError(
            f"{job.inputs['environment']} is {radiance.shape[1]} × {radiance.shape[0]} pixels; expected "
            "a picture of all directions, twice as wide as high."
        )
    return radiance


def _write_truths(
    job: Job[RenderSettings], surface: PaintedSurface, metal: PaintedSurface | None, cameras: list[Camera]
) -> list[Truth]:
    """Save albedo, mask and parts of every view, and keep what the images will be held against.

    Pixels that touch `metal` are kept out of the mask of what is judged, not out of the photos'.
    """
    from stages.formats.images.exr import write_exr
    from stages.formats.images.photos import write_mask, write_png8

    truths, folder = [], job.outputs["truth"]
    with job.progress("truth", len(cameras)) as step:
        for camera in cameras:
            truth = surface.truth(camera)
            truths.append(truth)
            write_exr(folder / "albedo" / f"{camera.name}.exr", truth.albedo)
            judged = truth.mask if metal is None else truth.mask & (metal.truth(camera).albedo[..., 0] == 0)
            write_mask(folder / "mask" / f"{camera.name}.png", judged)
            write_mask(job.outputs["masks"] / f"{camera.name}.png", truth.mask)
            write_png8(folder / "parts" / f"{camera.name}.png", truth.parts)
            step()
    return truths


def _write_image(job: Job[RenderSettings], camera: Camera, truth: Truth, image: np.ndarray) -> None:
    """Save an image, and the true shading: image over albedo where the albedo is known well enough."""
    import numpy as np

    from stages.formats.images.exr import write_exr

    known = truth.albedo >= job.settings.albedo_floor
    shading = np.where(known, image / np.where(known, truth.albedo, 1), 0).astype(np.float32)
    write_exr(job.outputs["images"] / f"{camera.name}.exr", image)
    write_exr(job.outputs["truth"] / "shading" / f"{camera.name}.exr", shading)


def _note(job: Job[RenderSettings], subject: Subject, noises: list[Noise]) -> None:
    import numpy as np

    job.note(
        faces=len(subject.surface.faces),
        parts=list(subject.part_names),
        noise=round(max(noise.all for noise in noises), 4),
        channel_noise=[round(float(v), 4) for v in np.max([noise.channels for noise in noises], axis=0)],
        samples_per_pixel=[round(noise.samples_per_pixel) for noise in noises],
    )
    if (worst := max(noise.all for noise in noises)) > job.settings.noise:
        job.warn(f"The noise stayed at {worst:.3f} of the mean; expected {job.settings.noise:g} at most.")


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{len(facts['samples_per_pixel'])} views of {facts['faces']:,} faces, noise {facts['noise']:.2%}"


RENDER = Stage(
    name="render",
    version=1,
    about="A scene with known truth, path-traced: photos, cameras and mesh of an experiment.",
    settings=RenderSettings,
    takes=(),
    may_take=("object", "environment"),
    gives=(
        Artefact("images", "rendered views, EXR, linear"),
        Artefact("model", "COLMAP sparse model: the exact cameras"),
        Artefact("true_mesh", "the surface that was rendered", file="true_mesh.ply"),
        Artefact("masks", "pixels that lie wholly on the subject, white = keep"),
        Artefact("truth", "true albedo, shading, parts and masks per view", output="truth"),
    ),
    run=run,
    tools=("mitsuba", "drjit", "scikit-image", "numpy", "scipy", "numba", *PYCOLMAP, *OPEN3D, *PICTURES),
    saves_memory="lower render.width_px and render.height_px",
    found=in_words,
)
