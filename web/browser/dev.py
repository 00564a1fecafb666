"""Serves web/dist in front of a running server, so that a change of the page needs no build of the program.

python3 web/browser/dev.py http://127.0.0.1:8080 [PORT]
"""

import contextlib
import http.client
import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit

DIST = Path(__file__).resolve().parent.parent / "dist"
KINDS = {".html": "text/html; charset=utf-8", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}


class Handler(BaseHTTPRequestHandler):
    """A file of the page, or what the server answers."""

    upstream = ""

    def any(self) -> None:
        name = {"/": "index.html"}.get(self.path, self.path.removeprefix("/assets/"))
        file = DIST / name
        if self.command == "GET" and "/" not in name and file.is_file():
            self.answer(200, [("Content-Type", KINDS[file.suffix]), *self.policy()], file.read_bytes())
            return
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        connection = http.client.HTTPConnection(self.upstream, timeout=120)
        kept = {k: v for k, v in self.headers.items() if k.lower() not in ("host", "connection", "origin")}
        try:
            connection.request(self.command, self.path, body or None, kept)
            response = connection.getresponse()
        except OSError:
            self.close_connection = True
            return
        headers = [(k, v) for k, v in response.getheaders() if k.lower() not in ("transfer-encoding", "connection")]
        if response.getheader("Content-Type", "").startswith("text/event-stream"):
            self.start(response.status, headers)
            self.close_connection = True
            # Either side may be gone at any moment: the stream ends, as it would without us.
            with contextlib.suppress(OSError, ValueError, http.client.HTTPException):
                while piece := response.read1():
                    self.wfile.write(piece)
                    self.wfile.flush()
            return
        headers = [(k, v) for k, v in headers if k.lower() != "content-length"]
        self.answer(response.status, headers, response.read())

    def policy(self) -> list[tuple[str, str]]:
        """What the server allows its page to do, if it can be asked: what breaks the policy must break here."""
        connection = http.client.HTTPConnection(self.upstream, timeout=120)
        try:
            connection.request("HEAD", "/")
            said = connection.getresponse().getheader("Content-Security-Policy")
        except OSError:
            return []
        return [("Content-Security-Policy", said)] if said else []

    def start(self, status: int, headers: list[tuple[str, str]]) -> None:
        self.send_response(status)
        for name, value in headers:
            self.send_header(name, value)
        self.end_headers()

    def answer(self, status: int, headers: list[tuple[str, str]], body: bytes) -> None:
        self.start(status, [*headers, ("Content-Length", str(len(body)))])
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Says nothing: the browser's own list of requests is better."""

    do_GET = do_POST = do_PUT = do_DELETE = any


def front(upstream: str, port: int = 0) -> ThreadingHTTPServer:
    """Serves the page at a port of loopback, a free one for 0, in front of the server at an address."""
    before = type("Before", (Handler,), {"upstream": urlsplit(upstream).netloc})
    return ThreadingHTTPServer(("127.0.0.1", port), before)


if __name__ == "__main__":
    server = front(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 8090)
    print(f"http://127.0.0.1:{server.server_port}")
    server.serve_forever()
