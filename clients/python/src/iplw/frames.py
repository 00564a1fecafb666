"""The protocol's messages over ZeroMQ: a MessagePack header, then a frame for each array.

    request   {v, id, op, args, arrays: [{name, dtype, shape}, ...], key?, raw?}
    reply     {v, id, ok: true, result, arrays} or {v, id, ok: false, problem}

An array stands under its dotted name in the arguments or the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgpack
import numpy as np

from . import codec
from .errors import Problem
from .call import Call

VERSION = 1


def request(number: int, call: Call[Any]) -> list[Any]:
    """The frames of a call."""
    args: dict[str, Any] = {}
    arrays: list[dict[str, Any]] = []
    frames: list[Any] = [b""]
    for name, value in call.args.items():
        if isinstance(value, np.ndarray):
            array = codec.plain(value)
            arrays.append({"name": name, "dtype": array.dtype.str, "shape": array.shape})
            frames.append(array)
        elif isinstance(value, bytes):
            arrays.append({"name": name, "dtype": "|u1", "shape": [len(value)]})
            frames.append(value)
        else:
            args[name] = value
    header: dict[str, Any] = {"v": VERSION, "id": number, "op": call.op, "args": args}
    if arrays:
        header["arrays"] = arrays
    if call.key is not None:
        header["key"] = call.key
    if call.raw:
        header["raw"] = True
    frames[0] = codec.pack(header)
    return frames


def control(number: int, op: str, **args: Any) -> list[bytes]:
    """The frames of an operation that the server answers at once: `ping`, `cancel`."""
    return [msgpack.packb({"v": VERSION, "id": number, "op": op, "args": args})]


def header(frames: Sequence[Any]) -> dict[str, Any]:
    """A reply's header; `ValueError` for what is none."""
    head = codec.unpack(frames[0])
    if not isinstance(head, dict) or "ok" not in head:
        raise ValueError("a reply without a header")
    return head


def answer(head: dict[str, Any], frames: Sequence[Any], binary: bool) -> Any:
    """The result with its arrays in place; a refusal raises `Problem`, nonsense `ValueError`."""
    if not head["ok"]:
        problem = head.get("problem") or {}
        raise Problem.from_json(int(problem.get("status") or 500), problem)
    described = head.get("arrays") or []
    if len(described) != len(frames) - 1:
        raise ValueError(f"{len(described)} arrays described, {len(frames) - 1} sent")
    result = head.get("result")
    if binary:
        if described:
            return bytes(frames[1])
        # A file that is JSON comes as what it says.
        return codec.to_json(result)
    for array, frame in zip(described, frames[1:]):
        if result is None:
            result = {}
        *outer, last = array["name"].split(".")
        place = result
        for part in outer:
            place = place[int(part)] if isinstance(place, list) else place.setdefault(part, {})
        place[last] = codec.from_bytes(array["dtype"], array["shape"], frame)
    return result
