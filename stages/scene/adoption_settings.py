"""Settings shared by the stages that adopt cameras which exist already."""

from typing import Literal

from pipeline import setting

SIZE_TOLERANCE_PX: float = setting(
    1.0,
    "Photos at another size than the model's are accepted if their aspect agrees to this many pixels.",
    unit="px",
    ge=0,
    le=16,
)
TurnedPhotos = Literal["as_stored", "upright"]
TURNED_PHOTOS: TurnedPhotos = setting(
    "as_stored",
    "How the model means photos that their header turns, where sizes leave both possible (180°, "
    "mirrored, squares). as_stored: as COLMAP takes them, which passes over that tag. upright: the model "
    "comes from a program that obeys it.",
)
