"""The setting shared by all stages that read or write environment maps."""

from pipeline import setting

UPRIGHT_WITHIN_DEG: float = setting(
    10.0,
    "Up, in environment maps, is the world's axis nearest to the vertical of the cameras, where it is within "
    "this angle of it; else that vertical, to which their x axes are most nearly perpendicular. Frames made "
    "by hand, and by most programs, have an axis upwards. `lighting`, `decomposition` and `relight` share "
    "these maps: set it equally there.",
    unit="°",
    ge=0,
    le=90,
)
