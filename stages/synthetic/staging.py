"""What the settings of a render mean: the subject's paint and gloss, the light around it, the cameras."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline import UserError
from stages.scene.cameras import Camera
from stages.scene.wording import listed
from stages.synthetic.lights import FOUR_LAMPS, ONE_LAMP, SKY_DOME, Environment, Light, lamps_around
from stages.synthetic.paint import paint_by_part, paint_for_matching, with_stripes
from stages.synthetic.render import Gloss
from stages.synthetic.render_settings import RenderSettings
from stages.synthetic.sensor_noise import with_sensor_noise
from stages.synthetic.subject import Subject
from stages.synthetic.views import arc_of_views, framed

STEEPEST_DEG = 85.0


def paint_of(
    settings: RenderSettings, subject: Subject, own_colours: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """The paint of every vertex, (V, 3), and 1 + the index of its part where that is uniform, (V,), else 0.

    `own_colours`, (V, 3), are those that the object brings, where the paint is those.
    """
    x = subject.surface.vertices
    if settings.paint == "vertex":
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


def gloss_of(settings: RenderSettings, subject: Subject) -> Gloss | None:
    """The mirror's share at every vertex; None where nothing is glossy."""
    if settings.gloss == 0:
        return None
    names = settings.glossy_parts or subject.part_names
    chosen = [part_index(subject, "glossy_parts", name) for name in names]
    return Gloss(settings.gloss * np.isin(subject.parts, chosen), settings.roughness)


def light_of(settings: RenderSettings, subject: Subject, surroundings: np.ndarray | None) -> Light:
    """The light by its name, placed around the subject; `surroundings`, (h, 2h, 3), where it is those."""
    if settings.light == "dome":
        return SKY_DOME
    if settings.light == "environment":
        return Light(Environment(surroundings, settings.turn_deg))
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
