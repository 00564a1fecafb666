"""A scripted ROUTER socket, for faults: silence, malformed replies, a busy server."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgpack
import zmq


@contextmanager
def router(answer: Any) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """A scripted server: `answer(header)` returns the frames of the reply, or None for no reply."""
    context = zmq.Context()
    bound: zmq.Socket[bytes] = context.socket(zmq.ROUTER)
    bound.setsockopt(zmq.LINGER, 0)
    port = bound.bind_to_random_port("tcp://127.0.0.1")
    observed: list[dict[str, Any]] = []
    done = threading.Event()

    def serve() -> None:
        while not done.is_set():
            if not bound.poll(20):
                continue
            peer, header, *_ = bound.recv_multipart()
            observed.append(msgpack.unpackb(header))
            reply = answer(observed[-1])
            if reply is not None:
                bound.send_multipart([peer, *reply])
        bound.close()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield f"tcp://127.0.0.1:{port}", observed
    finally:
        done.set()
        thread.join()
        context.destroy(0)


def ok(header: dict[str, Any], result: Any) -> list[bytes]:
    return [msgpack.packb({"v": 1, "id": header["id"], "ok": True, "result": result, "arrays": []})]
