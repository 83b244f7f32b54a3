"""Instead of photos: a scene of known truth, path-traced from exact cameras (the paper, Figs. 3 to 7)."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Literal

from pipeline import Artefact, Job, Settings, Stage, UserError, setting
from stages.scene.wording import listed

if TYPE_CHECKING:
    import numpy as np

    from stages.scene.cameras import Camera
    from stages.synthetic.lights import Light
    from stages.synthetic.photograph import Noise
    from stages.synthetic.render import Gloss
    from stages.synthetic.subject import Subject
    from stages.synthetic.truth import PaintedSurface, Truth

STEEPEST_DEG = 85.0


class RenderSettings(Settings):
    """Settings of the `render` stage."""

    paint: Literal["parts", "stripes", "texture", "vertex"] = setting(
        "parts",
        "parts: one colour each, as in the paper's Table 1. stripes: the same, with thin stripes on "
        "`striped_part`. texture: a many-coloured stone. vertex: the colours that the object brings.",
    )
    striped_part: str | None = setting("shirt", "The part that stripes cover; none: the whole subject.")
    stripe_period: float = setting(
        0.05, "Width of two stripes, one of each colour.", unit="subject radii", gt=0, le=10
    )
    light: Literal["dome", "four_lamps", "one_lamp", "environment"] = setting(
        "dome",
        "dome: a white sky above a dim ground. four_lamps, one_lamp: extended lamps, black surroundings. "
        "environment: the source `environment`.",
    )
    turn_deg: float = setting(
        0.0, "By how much the environment is turned, counter-clockwise seen from above.", unit="°"
    )
    gloss: float = setting(
        0.0, "Share of the reflection that is a rough mirror's, on `glossy_parts`.", ge=0, lt=1
    )
    glossy_parts: tuple[str, ...] = setting(
        ("hair", "plinth"), "The parts that are glossy where `gloss` is not 0. Empty: all."
    )
    roughness: float = setting(
        0.15, "Roughness α of the mirror (GGX): 0.15 makes highlights of some degrees.", gt=0, le=1
    )
    spacing: float = setting(
        0.004, "Grid of the bust's mesh; 0.004 gives 240 k faces.", unit="bust heights", ge=0.0015, le=0.05
    )
    y_up: bool = setting(False, "Whether the object's own mesh has y upwards and faces +z.")
    object_parts: int = setting(4, "Parts that an object's own mesh is divided into.", ge=1, le=200)
    views: int = setting(13, "Views on an arc around the subject; the paper has 13.", ge=1, le=1000)
    arc_deg: float = setting(108.0, "Azimuth from the first view to the last.", unit="°", ge=0, le=360)
    elevations_deg: tuple[float, ...] = setting(
        (5.0, 20.0), "Elevations, taken in turn from view to view.", unit="°", min_length=1
    )
    distance: float = setting(4.0, "From the subject's centre.", unit="subject radii", ge=1.5, le=100)
    width_px: int = setting(540, "Width of the images; the paper has 540.", unit="px", ge=16, le=16384)
    height_px: int = setting(960, "Height of the images; the paper has 960.", unit="px", ge=16, le=16384)
    noise: float = setting(
        0.02,
        "Samples are added until the scatter of pixel values is this share of their mean.",
        gt=0,
        le=1,
    )
    reflections: int = setting(
        6, "How often light may be reflected on its way; 1: no bounces between surfaces.", ge=1, le=64
    )
    sensor_noise: float = setting(
        0.0, "Noise a sensor adds: deviation at the mean value, growing with its root.", ge=0, le=1
    )
    blur_px: float = setting(
        0.0, "Deviation of a Gaussian blur, a lens out of focus.", unit="px", ge=0, le=64
    )


def run(job: Job) -> None:
    """Build, pose, photograph and measure; save the images as a pipeline wants them, the truth beside."""
    import numpy as np

    from stages.scene.colmap_model import pinhole_model
    from stages.scene.meshes import write_mesh
    from stages.synthetic.photograph import NoiseTarget, mean_level, photograph
    from stages.synthetic.render import Quality, Scene, use_threads
    from stages.synthetic.truth import PaintedSurface

    settings: RenderSettings = job.settings
    _require_mitsuba()
    use_threads(job.threads)
    subject, paint, uniform = _painted_subject(job)
    gloss = _gloss(settings, subject)
    albedo = paint if gloss is None else paint * (1 - gloss.share[:, None]).astype(np.float32)
    cameras = _cameras(settings, subject)
    truths = _write_truths(job, PaintedSurface(subject.surface, albedo, uniform), cameras)
    if not any(truth.mask.any() for truth in truths):
        raise UserError(
            f"The subject covers no whole pixel at {settings.width_px} × {settings.height_px}; render larger."
        )
    scene = Scene(subject.surface, paint, _light(job, subject), gloss)
    quality = Quality(samples=64, reflections=settings.reflections)
    target = NoiseTarget(settings.noise, mean_level(scene, cameras, [t.mask for t in truths], quality))
    noises = []
    with job.progress("renders", len(cameras)) as step:
        for index, (camera, truth) in enumerate(zip(cameras, truths, strict=True)):
            image, noise = photograph(scene, camera, truth.mask, quality, target, seed=1000 * index)
            noises.append(noise)
            _write_image(job, camera, truth, _through_lens(settings, image, truth.mask, index))
            step()
    pinhole_model(cameras, extension=".exr").write(job.outputs["model"])
    write_mesh(job.outputs["true_mesh"], subject.surface)
    (job.outputs["truth"] / "parts.json").write_text(
        json.dumps({"parts": list(subject.part_names)}) + "\n", encoding="utf-8"
    )
    _note(job, subject, noises)


def _require_mitsuba() -> None:
    from importlib.util import find_spec

    if find_spec("mitsuba") is None or find_spec("skimage") is None:
        raise UserError(
            "Rendering needs Mitsuba and scikit-image, which are not installed; install unshade with its "
            "extra: pip install 'unshade[synthetic]'."
        )


def _painted_subject(job: Job) -> tuple[Subject, np.ndarray, np.ndarray]:
    """The subject, its paint (V, 3), and 1 + index of the uniform part of every vertex, 0 for none."""
    import numpy as np

    from stages.scene.meshes import read_mesh, read_vertex_colours
    from stages.synthetic.paint import paint_by_part, paint_for_matching, with_stripes
    from stages.synthetic.subject import bust_subject, mesh_subject

    settings: RenderSettings = job.settings
    file = job.inputs.get("object")
    if file is None:
        subject = bust_subject(settings.spacing)
    else:
        subject = mesh_subject(read_mesh(file), settings.object_parts, settings.y_up)
    x = subject.surface.vertices
    if settings.paint == "vertex":
        if file is None:
            raise UserError("render.paint is vertex, but no object was given; give --object FILE.")
        return subject, read_vertex_colours(file), np.zeros(len(x), np.uint8)
    if settings.paint == "texture":
        finest = subject.radius / 200
        return subject, paint_for_matching(x, subject.parts, finest), np.zeros(len(x), np.uint8)
    paint, uniform = paint_by_part(subject.parts), subject.parts + np.uint8(1)
    if settings.paint == "stripes":
        striped = np.ones(len(x), bool)
        if settings.striped_part is not None:
            striped = subject.parts == _part_index(subject, "striped_part", settings.striped_part)
        paint = with_stripes(paint, x, striped, settings.stripe_period * subject.radius)
        uniform = np.where(striped, 0, uniform).astype(np.uint8)
    return subject, paint, uniform


def _part_index(subject: Subject, setting_name: str, part: str) -> int:
    if part not in subject.part_names:
        raise UserError(
            f"render.{setting_name} names the part {part!r}; this subject has {listed(subject.part_names)}."
        )
    return subject.part_names.index(part)


def _gloss(settings: RenderSettings, subject: Subject) -> Gloss | None:
    """The mirror's share at every vertex; None where nothing is glossy."""
    import numpy as np

    from stages.synthetic.render import Gloss

    if settings.gloss == 0:
        return None
    names = settings.glossy_parts or subject.part_names
    chosen = [_part_index(subject, "glossy_parts", name) for name in names]
    return Gloss(settings.gloss * np.isin(subject.parts, chosen), settings.roughness)


def _light(job: Job, subject: Subject) -> Light:
    """The light by its name, placed around the subject."""
    from stages.scene.photos import read_photo
    from stages.synthetic.lights import FOUR_LAMPS, ONE_LAMP, SKY_DOME, Environment, Light, lamps_around

    settings: RenderSettings = job.settings
    if settings.light == "dome":
        return SKY_DOME
    if settings.light == "environment":
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
        return Light(Environment(radiance, settings.turn_deg))
    places = FOUR_LAMPS if settings.light == "four_lamps" else ONE_LAMP
    return Light(None, lamps_around(places, subject.centre, subject.radius))


def _cameras(settings: RenderSettings, subject: Subject) -> list[Camera]:
    """An arc of cameras that see the whole subject as large as possible."""
    import numpy as np

    from stages.synthetic.views import arc_of_views, framed

    steep = [angle for angle in settings.elevations_deg if abs(angle) > STEEPEST_DEG]
    if steep:
        raise UserError(
            f"render.elevations_deg holds {steep[0]:g}; expected angles between −{STEEPEST_DEG:g} and "
            f"{STEEPEST_DEG:g}, for straight up and down have no upright picture."
        )
    half = settings.arc_deg / 2 if settings.views > 1 else 0.0
    azimuths = list(np.linspace(-half, half, settings.views))
    around = settings.elevations_deg
    elevations = [around[k % len(around)] for k in range(settings.views)]
    size = (settings.width_px, settings.height_px)
    distance = settings.distance * subject.radius
    cameras = arc_of_views(azimuths, elevations, distance, subject.centre, size, focal_px=1.0)
    return framed(cameras, subject.surface.vertices)


def _through_lens(settings: RenderSettings, image: np.ndarray, mask: np.ndarray, seed: int) -> np.ndarray:
    """The rendered image after blur and sensor noise, where these are wanted."""
    import cv2
    import numpy as np

    from stages.synthetic.sensor_noise import with_sensor_noise

    if settings.blur_px > 0:
        image = cv2.GaussianBlur(image, (0, 0), settings.blur_px)
    if settings.sensor_noise > 0 and mask.any():
        level = float(image[mask].mean())
        image = with_sensor_noise(image, 0.0, settings.sensor_noise * float(np.sqrt(level)), seed)
    return image


def _write_truths(job: Job, surface: PaintedSurface, cameras: list[Camera]) -> list[Truth]:
    """Save albedo, mask and parts of every view, and keep what the images will be held against."""
    from stages.scene.exr import write_exr
    from stages.scene.photos import write_mask, write_png8

    truths, folder = [], job.outputs["truth"]
    with job.progress("truth", len(cameras)) as step:
        for camera in cameras:
            truth = surface.truth(camera)
            truths.append(truth)
            write_exr(folder / "albedo" / f"{camera.name}.exr", truth.albedo)
            write_mask(folder / "mask" / f"{camera.name}.png", truth.mask)
            write_mask(job.outputs["masks"] / f"{camera.name}.png", truth.mask)
            write_png8(folder / "parts" / f"{camera.name}.png", truth.parts)
            step()
    return truths


def _write_image(job: Job, camera: Camera, truth: Truth, image: np.ndarray) -> None:
    """Save an image, and the true shading: image over albedo where the albedo is known well enough."""
    import numpy as np

    from stages.evaluation.judged_views import ALBEDO_FLOOR
    from stages.scene.exr import write_exr

    known = truth.albedo >= ALBEDO_FLOOR
    shading = np.where(known, image / np.where(known, truth.albedo, 1), 0).astype(np.float32)
    write_exr(job.outputs["images"] / f"{camera.name}.exr", image)
    write_exr(job.outputs["truth"] / "shading" / f"{camera.name}.exr", shading)


def _note(job: Job, subject: Subject, noises: list[Noise]) -> None:
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
    tools=("mitsuba", "scikit-image", "opencv-python-headless", "open3d-cpu", "open3d"),
)
