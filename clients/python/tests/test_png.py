"""Decoding of PNG variants."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from iplw import png

SEEN = np.random.default_rng(0).integers(0, 256, (7, 5, 3), dtype=np.uint8)


def encoded(picture: Image.Image) -> bytes:
    out = io.BytesIO()
    picture.save(out, "PNG")
    return out.getvalue()


def test_preserves_colours() -> None:
    decoded = png.decode(encoded(Image.fromarray(SEEN)))
    assert decoded.dtype == np.uint8 and np.array_equal(decoded, SEEN)
    decoded[0, 0] = 1


def test_converts_grey_and_palettes_to_rgb() -> None:
    grey = png.decode(encoded(Image.fromarray(SEEN[..., 0])))
    assert np.array_equal(grey, np.repeat(SEEN[..., :1], 3, axis=2))
    few = Image.fromarray(SEEN).quantize(4)
    assert np.array_equal(png.decode(encoded(few)), np.asarray(few.convert("RGB")))


def test_transparent_becomes_white() -> None:
    alpha = np.where(SEEN[..., :1] < 128, 0, 255).astype(np.uint8)
    decoded = png.decode(encoded(Image.fromarray(np.concatenate([SEEN, alpha], axis=2))))
    assert np.array_equal(decoded, np.where(alpha == 0, 255, SEEN))


def test_rejects_damaged_files() -> None:
    complete = encoded(Image.fromarray(SEEN))
    for broken in (b"<svg>", complete[:20], complete[:60], b"GIF89a" + complete):
        with pytest.raises(ValueError, match="PNG image"):
            png.decode(broken)
