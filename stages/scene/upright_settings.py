"""The setting that every stage shares which reads or writes pictures of all directions."""

from pipeline import setting

UPRIGHT_WITHIN_DEG: float = setting(
    20.0,
    "Up, in pictures of all directions, is the world's axis nearest to the mean of the cameras' up axes, "
    "where it is within this angle of it; else that mean. Frames made by hand, and by most programs, have "
    "an axis upwards. `lighting`, `decomposition` and `relight` share these pictures: set it alike there.",
    unit="°",
    ge=0,
    le=90,
)
