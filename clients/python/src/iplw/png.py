"""Decodes PNG images to arrays."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image


def decode(png: bytes) -> NDArray[np.uint8]:
    """(height, width, 3) RGB; transparent pixels become white. `ValueError` unless it is a complete PNG image."""
    try:
        with Image.open(io.BytesIO(png), formats=["PNG"]) as picture:
            colour = picture.convert("RGBA")
    except (OSError, SyntaxError) as error:
        raise ValueError(f"not a complete PNG image: {error}") from error
    white = Image.new("RGBA", colour.size, "white")
    return np.array(Image.alpha_composite(white, colour).convert("RGB"))
