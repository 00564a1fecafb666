"""A scripted HTTP server, for faults: dropped connections, silence, malformed responses."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


@dataclass
class Stub:
    url: str = ""
    #: (method, path, Last-Event-ID) of each request, in order.
    requests: list[tuple[str, str, str | None]] = field(default_factory=list)


Answer = Callable[[int, str, str], bytes | None]


def reply(status: str, body: str, kind: str = "application/json") -> bytes:
    return (
        f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
        f"Connection: close\r\n\r\n{body}"
    ).encode()


@contextmanager
def serving(answer: Answer, hold: bool = False) -> Iterator[Stub]:
    """`answer(number of the request, method, path)` returns the raw response; None closes the connection.

    `hold` keeps event streams open to the end, as a silent server would.
    """
    stub = Stub()
    done = threading.Event()

    class Handler(BaseHTTPRequestHandler):
        def _any(self) -> None:
            self.rfile.read(int(self.headers.get("Content-Length") or 0))
            stub.requests.append((self.command, self.path, self.headers.get("Last-Event-ID")))
            raw = answer(len(stub.requests) - 1, self.command, self.path)
            if raw is not None:
                self.wfile.write(raw)
                self.wfile.flush()
                if hold and self.path.endswith("/events"):
                    done.wait()
            self.close_connection = True

        do_GET = do_POST = do_DELETE = _any

        def log_message(self, format: str, *args: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    stub.url = f"http://127.0.0.1:{server.server_port}"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield stub
    finally:
        done.set()
        server.shutdown()
        server.server_close()
        thread.join()
