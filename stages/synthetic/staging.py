"""What the settings of a render mean: the subject's paint and gloss, the light around it, the cameras."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from pipeline import UserError
from stages.scene.cameras import Camera
from stages.scene.wording import listed
from stages.synthetic.lights import (
    FOUR_LAMPS,
    ONE_LAMP,
    SKY_DOME,
    ClearSky,
    Environment,
    Light,
    clear_sky_picture,
    lamps_around,
)
from stages.synthetic.paints.natural_paint import NATURAL_PAINTS, natural_paint, quilt
from stages.synthetic.paints.paint import paint_by_part, paint_for_matching, with_stripes
from stages.synthetic.paints.solid_noise import fractal_noise
from stages.synthetic.paints.textures.pattern import Scale
from stages.synthetic.render import Gloss
from stages.synthetic.render_settings import RenderSettings
from stages.synthetic.sensor_noise import with_sensor_noise
from stages.synthetic.subjects.subdivision import subdivided
from stages.synthetic.subjects.subject import Subject
from stages.synthetic.views import arc_of_views, framed

STEEPEST_DEG = 85.0
SMOOTHEST, ROUGHEST = 0.02, 1.0  # α: a smoother mirror reflects the sun's disc into single pixels
UNEVENNESS_SEED = 7_000_000_000  # apart from the paints'
FINEST_PX = 2.0  # wavelength of the finest detail of a paint: blobs of a deviation of about a pixel
LONGEST_EDGE_PX = 0.75  # of the faces that carry it: most edges are then half a pixel or shorter


def with_room_for_paint(settings: RenderSettings, subject: Subject, footprint: float) -> Subject:
    """Split the faces until vertices are half a pixel apart, where the paint has detail of two pixels.

    `footprint` is the side of a pixel at the subject's centre, model units. The surface stays as it is.
    """
    if settings.paint not in NATURAL_PAINTS or settings.paint == "plaster":
        return subject
    surface, origin = subdivided(subject.surface, LONGEST_EDGE_PX * footprint)
    return Subject(surface, subject.parts[origin], subject.part_names)


def paint_of(
    settings: RenderSettings, subject: Subject, own_colours: np.ndarray | None, footprint: float
) -> tuple[np.ndarray, np.ndarray]:
    """The paint of every vertex, (V, 3), and 1 + the index of its part where that is uniform, (V,), else 0.

    `own_colours`, (V, 3), are those that the object brings, where the paint is those. `footprint` is the side
    of a pixel at the subject's centre, model units.
    """
    x = subject.surface.vertices
    if settings.paint in NATURAL_PAINTS:
        return _natural_paint_of(settings, subject, Scale(FINEST_PX * footprint, subject.radius))
    if settings.paint == "vertex":
        if own_colours is None:
            raise ValueError("render.paint is vertex, but the object's own colours were not read")
        return own_colours, np.zeros(len(x), np.uint8)
    if settings.paint == "texture":
        return paint_for_matching(x, subject.parts, finest=subject.radius / 200), np.zeros(len(x), np.uint8)
    paint, uniform = paint_by_part(subject.parts), subject.parts + np.uint8(1)
    if settings.paint == "stripes":
        striped = np.ones(len(x), bool)
        if settings.striped_part is not None:
            striped = subject.parts == part_index(subject, "striped_part", settings.striped_part)
        paint = with_stripes(paint, x, striped, settings.stripe_period * subject.radius)
        uniform = np.where(striped, 0, uniform).astype(np.uint8)
    return paint, uniform


def _natural_paint_of(
    settings: RenderSettings, subject: Subject, scale: Scale
) -> tuple[np.ndarray, np.ndarray]:
    x, parts = subject.surface.vertices, subject.parts
    if settings.paint == "quilt":
        paint, plain = quilt(x, parts, scale, settings.contrast, settings.paint_seed)
    else:
        paint = natural_paint(settings.paint, x, scale, settings.contrast, settings.paint_seed)
        plain = np.full(len(x), settings.paint == "plaster")
    return paint, np.where(plain, parts + np.uint8(1), 0).astype(np.uint8)


def footprint_of(cameras: list[Camera], centre: np.ndarray) -> float:
    """Side of a pixel at the subject's centre in the nearest view, model units."""
    return min(
        float(np.linalg.norm(camera.centre_in_world - centre)) / camera.intrinsics[0, 0] for camera in cameras
    )


def part_index(subject: Subject, setting_name: str, part: str) -> int:
    """Index of a part that a setting names.

    Raises
    ------
    UserError
        The subject has no such part.
    """
    if part not in subject.part_names:
        raise UserError(
            f"render.{setting_name} names the part {part!r}; this subject has {listed(subject.part_names)}."
        )
    return subject.part_names.index(part)


def metal_of(settings: RenderSettings, subject: Subject) -> np.ndarray:
    """Which vertices are bare metal, shape (V,), bool."""
    if settings.metal_part is None:
        return np.zeros(len(subject.parts), bool)
    return subject.parts == part_index(subject, "metal_part", settings.metal_part)


def gloss_of(settings: RenderSettings, subject: Subject, paint: np.ndarray, footprint: float) -> Gloss | None:
    """Share, roughness and colour of the mirror at every vertex; None where nothing is glossy or metal."""
    metal = metal_of(settings, subject)
    if settings.gloss == 0 and not metal.any():
        return None
    share: np.ndarray = np.zeros(len(subject.parts))
    if settings.gloss > 0:
        names = settings.glossy_parts or subject.part_names
        chosen = [part_index(subject, "glossy_parts", name) for name in names]
        share = settings.gloss * np.isin(subject.parts, chosen)
    gloss = Gloss.white(np.where(metal, 1.0, share), settings.roughness)
    roughness = gloss.roughness * _unevenness(settings, subject, footprint)
    colour = np.where(metal[:, None], paint, gloss.colour)
    return Gloss(gloss.share, np.clip(roughness, SMOOTHEST, ROUGHEST), colour)


def _unevenness(settings: RenderSettings, subject: Subject, footprint: float) -> np.ndarray:
    """Factor on the roughness, (V,): log-normal, with a 1/f spectrum, apart from the paint's."""
    if settings.roughness_contrast == 0:
        return np.ones(len(subject.parts))
    noise = fractal_noise(
        subject.surface.vertices, subject.radius, FINEST_PX * footprint, UNEVENNESS_SEED + settings.paint_seed
    )
    return np.exp(settings.roughness_contrast * noise)


def light_of(settings: RenderSettings, subject: Subject, surroundings: np.ndarray | None) -> Light:
    """The light by its name, placed around the subject; `surroundings`, (h, 2h, 3), where it is those."""
    if settings.light == "dome":
        return SKY_DOME
    if settings.light == "environment":
        if surroundings is None:
            raise ValueError("render.light is environment, but no picture of it was read")
        return Light(Environment(surroundings, settings.turn_deg))
    if settings.light == "sun_and_sky":
        sky = ClearSky(sun_elevation_deg=settings.sun_elevation_deg)
        return Light(replace(clear_sky_picture(sky), turn_deg=settings.turn_deg))
    places = FOUR_LAMPS if settings.light == "four_lamps" else ONE_LAMP
    return Light(None, lamps_around(places, subject.centre, subject.radius))


def cameras_of(settings: RenderSettings, subject: Subject) -> list[Camera]:
    """An arc of cameras that see the whole subject as large as possible.

    Raises
    ------
    UserError
        An elevation is straight up or down, or nearly.
    """
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


def through_lens(settings: RenderSettings, image: np.ndarray, mask: np.ndarray, seed: int) -> np.ndarray:
    """A rendered image, (h, w, 3), after blur and sensor noise, where these are wanted."""
    if settings.blur_px > 0:
        image = cv2.GaussianBlur(image, (0, 0), settings.blur_px)
    if settings.sensor_noise > 0 and mask.any():
        level = float(image[mask].mean())
        image = with_sensor_noise(image, 0.0, settings.sensor_noise * float(np.sqrt(level)), seed)
    return image
