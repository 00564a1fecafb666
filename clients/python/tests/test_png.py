"""Every filter and colour type, against an encoder written from the specification."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
import pytest

from iplw import png

CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}


def paeth(a: int, b: int, c: int) -> int:
    return min((a, b, c), key=lambda v: abs(a + b - c - v))


def encode(pixels: np.ndarray[Any, Any], colour: int, filters: list[int]) -> bytes:
    height, width, n = pixels.shape
    raw = bytearray()
    for y in range(height):
        kind = filters[y % len(filters)]
        raw.append(kind)
        for i in range(width * n):
            x, k = divmod(i, n)
            value = int(pixels[y, x, k])
            left = int(pixels[y, x - 1, k]) if x else 0
            above = int(pixels[y - 1, x, k]) if y else 0
            corner = int(pixels[y - 1, x - 1, k]) if x and y else 0
            guess = [0, left, above, (left + above) // 2, paeth(left, above, corner)][kind]
            raw.append((value - guess) % 256)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    data = zlib.compress(bytes(raw))
    head = struct.pack(">IIBBBBB", width, height, 8, colour, 0, 0, 0)
    # Two data chunks: they are one stream.
    parts = [chunk(b"IHDR", head), chunk(b"IDAT", data[:9]), chunk(b"IDAT", data[9:]), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


@pytest.mark.parametrize("colour", CHANNELS)
@pytest.mark.parametrize("filters", [[0], [1], [2], [3], [4], [4, 2, 0, 1, 3]])
def test_decodes(colour: int, filters: list[int]) -> None:
    pixels = np.random.default_rng(colour).integers(0, 256, (7, 5, CHANNELS[colour]), dtype=np.uint8)
    if colour in (4, 6):
        pixels[..., -1] = np.where(pixels[..., -1] < 128, 0, 255)
    decoded = png.decode(encode(pixels, colour, filters))
    expected = pixels[..., :3] if colour in (2, 6) else np.repeat(pixels[..., :1], 3, axis=2)
    if colour in (4, 6):
        expected = np.where(pixels[..., -1:] == 0, 255, expected)
    assert decoded.dtype == np.uint8 and np.array_equal(decoded, expected)


def test_damage_is_named() -> None:
    whole = encode(np.zeros((4, 4, 3), dtype=np.uint8), 2, [0])
    for broken in (b"<svg>", whole[:20], whole[:45]):
        with pytest.raises(ValueError, match="PNG picture"):
            png.decode(broken)
