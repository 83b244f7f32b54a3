"""EXR files as other programs leave them: with values that are no light."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR


def write_raw_exr(path: Path, image: np.ndarray, **attributes: object) -> None:
    """Write (h, w, 3) or, with alpha, (h, w, 4), whatever the values are, creating the folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    channels = "RGB" if image.shape[2] == 3 else "RGBA"
    with OpenEXR.File(header, {channels: np.ascontiguousarray(image, np.float32)}) as file:
        file.write(str(path))
