"""A server with the page in Debian's Chromium. Every test checks that the page sends no external requests and logs no
unexpected messages to its console."""

import json
import os
import re
import shutil
import subprocess
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from dev import dist_proxy
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

ROOT = Path(__file__).resolve().parents[2]
BINARY = Path(os.environ.get("IPLW_BIN", ROOT / "target/debug/iplw"))
#: Timeout of expectations, ms, generous for loaded machines.
TIMEOUT_MS = int(os.environ.get("TIMEOUT_MS", 120_000))
expect.set_options(timeout=TIMEOUT_MS)


class Server:
    """A private server with its data in a folder; it can be killed and restarted at the same address."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder, self.arguments, self.url, self.page, self.token = folder, arguments, "", "", ""
        self.start("127.0.0.1:0")

    def start(self, address: str) -> None:
        command = [BINARY, "serve", "--http", address, "--data-dir", self.folder, *self.arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout
        line = self.process.stdout.readline()
        match = re.search(r"http://\S+", line)
        assert match, f"unexpected output of the server: {line!r}"
        self.url = match[0]
        if not self.page:
            self.page = self.serve_dist() if os.environ.get("PAGE") == "dist" else self.url

    def serve_dist(self) -> str:
        """Serves the current web/dist in front of the server, in place of the page embedded in the program; returns its address."""
        page = dist_proxy(self.url)
        threading.Thread(target=page.serve_forever, daemon=True).start()
        return f"http://127.0.0.1:{page.server_port}"

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def restart(self) -> None:
        self.start(self.url.removeprefix("http://"))

    def request(self, method: str, path: str, body: Any = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        headers = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        request = urllib.request.Request(self.url + path, data, headers, method=method)
        with urllib.request.urlopen(request, timeout=120) as response:
            text = response.read()
        return json.loads(text) if text else None

    def wait_for_job(self, job: str) -> Any:
        for _ in range(3000):
            row = self.request("GET", f"/v1/jobs/{job}")
            if row["state"] in ("succeeded", "failed", "cancelled"):
                return row
            time.sleep(0.1)
        raise AssertionError(f"{job} did not end: {row}")


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Server]]:
    """Starts servers, which are killed after the test."""
    servers: list[Server] = []

    def start(*arguments: str) -> Server:
        servers.append(Server(tmp_path / f"data-{len(servers)}", *arguments))
        return servers[-1]

    yield start
    for server in servers:
        server.kill()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    executable = shutil.which("chromium") or shutil.which("chromium-browser")
    if not executable:
        pytest.skip("no Chromium: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox", "--disable-gpu"])
        yield browser
        browser.close()


class MonitoredPage:
    """A page, its requests and its console messages."""

    def __init__(self, context: BrowserContext, server: Server) -> None:
        self.server, self.requests, self.messages = server, [], []  # type: ignore[var-annotated]
        context.set_default_timeout(TIMEOUT_MS)
        self.page: Page = context.new_page()
        self.page.on("request", lambda r: self.requests.append(r.url))
        self.page.on("pageerror", lambda e: self.messages.append(str(e)))
        self.page.on("console", lambda m: self.messages.append(m.text) if m.type in ("error", "warning") else None)

    def open(self, address: str = "#/") -> Page:
        self.page.goto(f"{self.server.page}/{address}")
        return self.page

    def check(self, expected: str = "Failed to load resource") -> None:
        """Checks that there are no external requests, and no console messages except failed requests, which browsers log."""
        foreign = [u for u in self.requests if not u.startswith((self.server.page, "blob:", "data:"))]
        assert foreign == []
        assert [line for line in self.messages if expected not in line] == []


@pytest.fixture
def new_page(browser: Browser) -> Iterator[Callable[..., MonitoredPage]]:
    """Opens the page of a server in a new browser context."""
    contexts: list[tuple[BrowserContext, MonitoredPage]] = []

    def open(server: Server, **options: Any) -> MonitoredPage:
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 900}, **options})
        contexts.append((context, MonitoredPage(context, server)))
        return contexts[-1][1]

    yield open
    for context, session in contexts:
        session.check()
        context.close()
