"""Arrays on the wire: MessagePack with raw arrays, JSON with lists.

An array is raw little-endian bytes in C order with its dtype and shape: in MessagePack the extension type 78 over
`[dtype, shape, bytes]`, in ZeroMQ a frame of its own that the header describes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:
    import msgpack
except ImportError:  # HTTP does without.
    msgpack = None

#: Extension type of an array in MessagePack.
ARRAY = 78
#: Bytes set aside for packing: so many come quickly, msgpack's own 256 KiB from the system each time. It grows.
_BUFFER = 65536
#: What the server takes, as NumPy writes it.
DTYPES = frozenset({"<f4", "<f8", "<i4", "<i8", "<u4", "<u8", "|u1", "|b1"})


def has_msgpack() -> bool:
    """Whether MessagePack is installed."""
    return msgpack is not None


def to_json(value: Any) -> bytes:
    """JSON with arrays as lists; numbers that are not finite raise `ValueError`."""
    return _ENCODER.encode(value).encode()


def pack(value: Any) -> bytes:
    """MessagePack with arrays raw; whole numbers beyond 64 bits raise `ValueError`."""
    try:
        packed: bytes = msgpack.packb(value, default=_extension, buf_size=_BUFFER)
    except OverflowError as error:
        raise ValueError(f"cannot send a whole number beyond 64 bits ({error})") from error
    return packed


def unpack(data: bytes) -> Any:
    """MessagePack to lists, dicts and arrays; anything else is a `ValueError`."""
    try:
        return msgpack.unpackb(data, ext_hook=_array, strict_map_key=False)
    except (msgpack.exceptions.UnpackException, msgpack.exceptions.ExtraData) as error:
        raise ValueError(f"not MessagePack: {error}") from error


def plain(array: NDArray[Any]) -> NDArray[Any]:
    """The array in a form that the server takes: one of `DTYPES`, contiguous."""
    if array.dtype.str not in DTYPES:
        wider = {"f": "<f8", "i": "<i8", "u": "<u8", "b": "|b1"}.get(array.dtype.kind)
        if wider is None:
            raise ValueError(f"an array of {array.dtype}; allowed: numbers or booleans")
        array = array.astype(wider)
    return np.ascontiguousarray(array)


def from_bytes(dtype: str, shape: list[int], data: Any) -> NDArray[Any]:
    """An array of our own from the wire's bytes; `ValueError` if they do not fit."""
    if dtype not in DTYPES:
        raise ValueError(f"an array of dtype {dtype!r}; allowed: {', '.join(sorted(DTYPES))}")
    array = np.frombuffer(data, dtype=dtype).reshape(shape)
    # A copy unless the memory is a bytearray of its own: bytes may not be written to.
    return array if array.flags.writeable else array.copy()


def _listed(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Mapping) or (hasattr(value, "to_dict") and getattr(value, "ndim", None) == 1):
        return dict(value.items())  # A pandas Series: latents by name, say.
    raise TypeError(f"cannot send {type(value).__name__}")


#: Made once: json.dumps would make one for every request.
_ENCODER = json.JSONEncoder(allow_nan=False, default=_listed)


def _extension(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        array = plain(value)
        return msgpack.ExtType(ARRAY, msgpack.packb([array.dtype.str, array.shape, array.tobytes()], buf_size=_BUFFER))
    return _listed(value)


def _array(code: int, data: bytes) -> Any:
    if code != ARRAY:
        return msgpack.ExtType(code, data)
    dtype, shape, body = msgpack.unpackb(data)
    return from_bytes(dtype, shape, body)
