"""Serves web/dist in front of a running server, so that changes of the page need no build of the program.

python3 web/browser/dev.py http://127.0.0.1:8080 [PORT]
"""

import contextlib
import http.client
import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit

DIST = Path(__file__).resolve().parent.parent / "dist"
MIME_TYPES = {".html": "text/html; charset=utf-8", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}


class Handler(BaseHTTPRequestHandler):
    """Serves files of the page, and forwards other requests to the server."""

    upstream = ""

    def handle_request(self) -> None:
        name = {"/": "index.html"}.get(self.path, self.path.removeprefix("/assets/"))
        file = DIST / name
        if self.command == "GET" and "/" not in name and file.is_file():
            self.send(200, [("Content-Type", MIME_TYPES[file.suffix]), *self.content_policy()], file.read_bytes())
            return
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        connection = http.client.HTTPConnection(self.upstream, timeout=120)
        forwarded = {k: v for k, v in self.headers.items() if k.lower() not in ("host", "connection", "origin")}
        try:
            connection.request(self.command, self.path, body or None, forwarded)
            response = connection.getresponse()
        except OSError:
            self.close_connection = True
            return
        headers = [(k, v) for k, v in response.getheaders() if k.lower() not in ("transfer-encoding", "connection")]
        if response.getheader("Content-Type", "").startswith("text/event-stream"):
            self.send_head(response.status, headers)
            self.close_connection = True
            # Either side may disconnect at any time, which ends the stream.
            with contextlib.suppress(OSError, ValueError, http.client.HTTPException):
                while piece := response.read1():
                    self.wfile.write(piece)
                    self.wfile.flush()
            return
        headers = [(k, v) for k, v in headers if k.lower() != "content-length"]
        self.send(response.status, headers, response.read())

    def content_policy(self) -> list[tuple[str, str]]:
        """The server's Content-Security-Policy, if reachable: the page must work under the same policy."""
        connection = http.client.HTTPConnection(self.upstream, timeout=120)
        try:
            connection.request("HEAD", "/")
            policy = connection.getresponse().getheader("Content-Security-Policy")
        except OSError:
            return []
        return [("Content-Security-Policy", policy)] if policy else []

    def send_head(self, status: int, headers: list[tuple[str, str]]) -> None:
        self.send_response(status)
        for name, value in headers:
            self.send_header(name, value)
        self.end_headers()

    def send(self, status: int, headers: list[tuple[str, str]], body: bytes) -> None:
        self.send_head(status, [*headers, ("Content-Length", str(len(body)))])
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Disabled: the browser lists requests."""

    do_GET = do_POST = do_PUT = do_PATCH = do_DELETE = handle_request


def dist_proxy(upstream: str, port: int = 0) -> ThreadingHTTPServer:
    """Serves the page on a loopback port (0: any free one) in front of the server at an address."""
    handler = type("ProxyHandler", (Handler,), {"upstream": urlsplit(upstream).netloc})
    return ThreadingHTTPServer(("127.0.0.1", port), handler)


if __name__ == "__main__":
    server = dist_proxy(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 8090)
    print(f"http://127.0.0.1:{server.server_port}")
    server.serve_forever()
