"""Serialisation of arrays: MessagePack with raw bytes, JSON with lists.

A raw array is little-endian bytes in C order with a dtype and a shape: in MessagePack the extension type 78 with
`[dtype, shape, bytes]`, in ZeroMQ a separate frame described by the header.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:
    import msgpack
except ImportError:  # Optional for HTTP.
    msgpack = None

#: MessagePack extension type of an array.
ARRAY_EXTENSION = 78
#: Initial buffer for packing, bytes. msgpack's default of 256 KiB is slower to allocate.
_PACK_BUFFER_BYTES = 65536
#: Array types that the server accepts, as NumPy dtype strings.
DTYPES = frozenset({"<f4", "<f8", "<i4", "<i8", "<u4", "<u8", "|u1", "|b1"})


def has_msgpack() -> bool:
    """Whether MessagePack is installed."""
    return msgpack is not None


def to_json(value: Any) -> bytes:
    """JSON with arrays as lists; numbers that are not finite raise `ValueError`."""
    return _ENCODER.encode(value).encode()


def pack(value: Any) -> bytes:
    """MessagePack with raw arrays; integers beyond 64 bits raise `ValueError`."""
    try:
        packed: bytes = msgpack.packb(value, default=_msgpack_default, buf_size=_PACK_BUFFER_BYTES)
    except OverflowError as error:
        raise ValueError(f"cannot send an integer beyond 64 bits ({error})") from error
    return packed


def unpack(data: bytes) -> Any:
    """Decodes MessagePack to lists, dicts and arrays; `ValueError` if it is malformed."""
    try:
        return msgpack.unpackb(data, ext_hook=_array, strict_map_key=False)
    except (msgpack.exceptions.UnpackException, msgpack.exceptions.ExtraData) as error:
        raise ValueError(f"not MessagePack: {error}") from error


def as_wire_array(array: NDArray[Any]) -> NDArray[Any]:
    """The array with a dtype that the server accepts, contiguous."""
    if array.dtype.str not in DTYPES:
        wire_dtype = {"f": "<f8", "i": "<i8", "u": "<u8", "b": "|b1"}.get(array.dtype.kind)
        if wire_dtype is None:
            raise ValueError(f"an array of {array.dtype}; allowed: numbers or booleans")
        array = array.astype(wire_dtype)
    return np.ascontiguousarray(array)


def from_bytes(dtype: str, shape: list[int], data: Any) -> NDArray[Any]:
    """A writable array from bytes; `ValueError` if dtype or shape do not match."""
    if dtype not in DTYPES:
        raise ValueError(f"an array of dtype {dtype!r}; allowed: {', '.join(sorted(DTYPES))}")
    array = np.frombuffer(data, dtype=dtype).reshape(shape)
    # `bytes` are read-only: copy them.
    return array if array.flags.writeable else array.copy()


def _json_default(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Mapping) or (hasattr(value, "to_dict") and getattr(value, "ndim", None) == 1):
        return dict(value.items())  # A pandas Series, for example latents by name.
    raise TypeError(f"cannot send {type(value).__name__}")


#: Created once: json.dumps would create one for each request.
_ENCODER = json.JSONEncoder(allow_nan=False, default=_json_default)


def _msgpack_default(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        array = as_wire_array(value)
        return msgpack.ExtType(ARRAY_EXTENSION, msgpack.packb([array.dtype.str, array.shape, array.tobytes()], buf_size=_PACK_BUFFER_BYTES))
    return _json_default(value)


def _array(code: int, data: bytes) -> Any:
    if code != ARRAY_EXTENSION:
        return msgpack.ExtType(code, data)
    dtype, shape, body = msgpack.unpackb(data)
    return from_bytes(dtype, shape, body)
