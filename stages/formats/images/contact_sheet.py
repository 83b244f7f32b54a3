"""A picture of everything: one row per view, one column per map."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw, ImageFont

MARGIN_PX = 6  # of the layout, as is the next
CAPTION_PX = 18
INK, PAPER = (40, 40, 40), (255, 255, 255)


def contact_sheet(rows: dict[str, list[np.ndarray]], headings: list[str], width_px: int) -> np.ndarray:
    """Lay out pictures in a grid with captions.

    Parameters
    ----------
    rows : dict of str to list of ndarray, shape (h, w, 3), uint8, sRGB
        Per view name, one picture per heading.
    headings : list of str
    width_px : int
        Width of every picture; heights follow.

    Returns
    -------
    ndarray, shape (height, width, 3), uint8, sRGB
    """
    tiles = {name: [_tile(picture, width_px) for picture in pictures] for name, pictures in rows.items()}
    row_heights = [max(tile.height for tile in row) + CAPTION_PX + MARGIN_PX for row in tiles.values()]
    width = len(headings) * (width_px + MARGIN_PX) + MARGIN_PX
    sheet = Image.new("RGB", (width, sum(row_heights) + CAPTION_PX + 2 * MARGIN_PX), PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    columns = [MARGIN_PX + index * (width_px + MARGIN_PX) for index in range(len(headings))]
    for x, heading in zip(columns, headings, strict=True):
        draw.text((x, MARGIN_PX), heading, INK, font)
    y = MARGIN_PX + CAPTION_PX
    for (name, row), height in zip(tiles.items(), row_heights, strict=True):
        draw.text((columns[0], y), name, INK, font)
        for x, tile in zip(columns, row, strict=True):
            sheet.paste(tile, (x, y + CAPTION_PX))
        y += height
    return np.asarray(sheet)


def _tile(picture: np.ndarray, width_px: int) -> Image.Image:
    image = Image.fromarray(picture)
    height = max(1, round(image.height * width_px / image.width))
    return image.resize((width_px, height), Image.Resampling.LANCZOS)
