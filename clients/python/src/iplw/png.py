"""PNG pictures as arrays, by Pillow."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image


def decode(png: bytes) -> NDArray[np.uint8]:
    """(height, width, 3) RGB; transparent parts over white. What is no whole PNG picture is a `ValueError`."""
    try:
        with Image.open(io.BytesIO(png), formats=["PNG"]) as picture:
            colour = picture.convert("RGBA")
    except (OSError, SyntaxError) as error:
        raise ValueError(f"not a whole PNG picture: {error}") from error
    white = Image.new("RGBA", colour.size, "white")
    return np.array(Image.alpha_composite(white, colour).convert("RGB"))
