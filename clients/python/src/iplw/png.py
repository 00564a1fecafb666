"""PNG to NumPy, as far as the server's pictures need: 8 bits, RGB or RGBA or grey, not interlaced.

Source: W3C, Portable Network Graphics (third edition), sections 5 (chunks) and 9 (filters).
"""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
#: Colour type -> channels.
_CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}
_PAETH = 4


def decode(png: bytes) -> NDArray[np.uint8]:
    """(height, width, 3) RGB; transparent parts over white."""
    if not png.startswith(_SIGNATURE):
        raise ValueError(f"not a PNG picture: it starts with {png[:8]!r}")
    header, data = b"", []
    at = len(_SIGNATURE)
    while at + 8 <= len(png):
        length, kind = int.from_bytes(png[at : at + 4], "big"), png[at + 4 : at + 8]
        body = png[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            header = body
        elif kind == b"IDAT":
            data.append(body)
        at += length + 12
    if len(header) != 13:
        raise ValueError("not a PNG picture: no header")
    width, height = int.from_bytes(header[:4], "big"), int.from_bytes(header[4:8], "big")
    depth, colour, interlace = header[8], header[9], header[12]
    if depth != 8 or colour not in _CHANNELS or interlace:
        raise ValueError(
            f"PNG of depth {depth}, colour type {colour}, interlace {interlace}; allowed: 8 bits, plain"
        )
    channels = _CHANNELS[colour]
    try:
        rows = np.frombuffer(zlib.decompress(b"".join(data)), dtype=np.uint8)
        rows = rows.reshape(height, 1 + width * channels)
    except (zlib.error, ValueError) as error:
        raise ValueError(f"PNG picture is damaged: {error}") from error
    return _rgb(_unfilter(rows[:, 0], rows[:, 1:].reshape(height, width, channels)))


def _unfilter(filters: NDArray[np.uint8], coded: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Undoes each row's filter; `coded` is (height, width, channels)."""
    height, width, channels = coded.shape
    pixels = np.empty_like(coded)
    above = np.zeros((width, channels), dtype=np.uint8)
    for row in range(height):
        kind, line = int(filters[row]), coded[row]
        if kind == 0:
            pixels[row] = line
        elif kind == 1:
            # Each byte adds its left neighbour: a running sum modulo 256.
            pixels[row] = np.cumsum(line, axis=0, dtype=np.uint8)
        elif kind == 2:
            pixels[row] = line + above
        elif kind in (3, _PAETH):
            pixels[row] = _sequential(kind, line, above)
        else:
            raise ValueError(f"PNG picture is damaged: filter {kind} in row {row}")
        above = pixels[row]
    return pixels


def _sequential(kind: int, line: NDArray[np.uint8], above: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Average and Paeth: every byte needs the decoded one on its left."""
    width, channels = line.shape
    coded, up, out = line.tobytes(), above.tobytes(), bytearray(width * channels)
    for i in range(width * channels):
        left, over, corner = (out[i - channels], up[i], up[i - channels]) if i >= channels else (0, up[i], 0)
        if kind == _PAETH:
            toward_left, toward_over = abs(over - corner), abs(left - corner)
            toward_corner = abs(left + over - 2 * corner)
            if toward_left <= toward_over and toward_left <= toward_corner:
                guess = left
            else:
                guess = over if toward_over <= toward_corner else corner
        else:
            guess = (left + over) // 2
        out[i] = (coded[i] + guess) & 255
    return np.frombuffer(bytes(out), dtype=np.uint8).reshape(width, channels)


def _rgb(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    channels = pixels.shape[2]
    colour = np.repeat(pixels[..., :1], 3, axis=2) if channels < 3 else pixels[..., :3]
    if channels in (1, 3):
        return np.ascontiguousarray(colour)
    alpha = pixels[..., -1:].astype(np.uint16)
    blended = (colour * alpha + 255 * (255 - alpha) + 127) // 255
    return np.ascontiguousarray(blended.astype(np.uint8))
