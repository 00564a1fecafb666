"""Messages of the ZeroMQ protocol: a MessagePack header, then one frame for each array.

    request   {v, id, op, args, arrays: [{name, dtype, shape}, ...], key?, raw?}
    reply     {v, id, ok: true, result, arrays} or {v, id, ok: false, problem}

`name` is the dotted path of an array in the arguments or the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgpack
import numpy as np

from . import codec
from .errors import Problem
from .request import Request

VERSION = 1


def encode_request(number: int, request: Request[Any]) -> list[Any]:
    """Encodes a request."""
    args: dict[str, Any] = {}
    arrays: list[dict[str, Any]] = []
    frames: list[Any] = [b""]
    for name, value in request.args.items():
        if isinstance(value, np.ndarray):
            array = codec.as_wire_array(value)
            arrays.append({"name": name, "dtype": array.dtype.str, "shape": array.shape})
            frames.append(array)
        elif isinstance(value, bytes):
            arrays.append({"name": name, "dtype": "|u1", "shape": [len(value)]})
            frames.append(value)
        else:
            args[name] = value
    header: dict[str, Any] = {"v": VERSION, "id": number, "op": request.operation_id, "args": args}
    if arrays:
        header["arrays"] = arrays
    if request.key is not None:
        header["key"] = request.key
    if request.raw_arrays:
        header["raw"] = True
    frames[0] = codec.pack(header)
    return frames


def encode_control(number: int, op: str, **args: Any) -> list[bytes]:
    """Encodes a control operation: `ping`, `cancel`."""
    return [msgpack.packb({"v": VERSION, "id": number, "op": op, "args": args})]


def decode_header(frames: Sequence[Any]) -> dict[str, Any]:
    """Decodes the header of a reply; `ValueError` if it is malformed."""
    head = codec.unpack(frames[0])
    if not isinstance(head, dict) or "ok" not in head:
        raise ValueError("reply without a header")
    return head


def decode_reply(head: dict[str, Any], frames: Sequence[Any], binary: bool) -> Any:
    """Decodes the result with its arrays; raises `Problem` for an error, `ValueError` if it is malformed."""
    if not head["ok"]:
        problem = head.get("problem") or {}
        raise Problem.from_json(int(problem.get("status") or 500), problem)
    descriptions = head.get("arrays") or []
    if len(descriptions) != len(frames) - 1:
        raise ValueError(f"{len(descriptions)} arrays described, {len(frames) - 1} sent")
    result = head.get("result")
    if binary:
        if descriptions:
            return bytes(frames[1])
        # A file in JSON is returned as text.
        return codec.to_json(result)
    for array, frame in zip(descriptions, frames[1:]):
        if result is None:
            result = {}
        *outer, last = array["name"].split(".")
        place = result
        for part in outer:
            place = place[int(part)] if isinstance(place, list) else place.setdefault(part, {})
        place[last] = codec.from_bytes(array["dtype"], array["shape"], frame)
    return result
