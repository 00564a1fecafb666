"""A server with the page in Debian's Chromium. Every test sees to it that the page asks nobody else and says nothing on
its console that was not expected."""

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
from dev import front
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

ROOT = Path(__file__).resolve().parents[2]
BINARY = Path(os.environ.get("IPLW_BIN", ROOT / "target/debug/iplw"))
#: How long something may take to be seen, ms. A machine that does other things too is slow; nothing here measures time by waiting.
PATIENCE = int(os.environ.get("PATIENCE", 30_000))
expect.set_options(timeout=PATIENCE)


class Server:
    """A server of its own, with what it keeps in a folder; it can be killed and come back at the same address."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder, self.arguments, self.url, self.page, self.token = folder, arguments, "", "", ""
        self.start("127.0.0.1:0")

    def start(self, address: str) -> None:
        command = [BINARY, "serve", "--http", address, "--data-dir", self.folder, *self.arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout
        line = self.process.stdout.readline()
        found = re.search(r"http://\S+", line)
        assert found, f"the server said {line!r}"
        self.url = found[0]
        if not self.page:
            self.page = self.before() if os.environ.get("PAGE") == "dist" else self.url

    def before(self) -> str:
        """Address of web/dist as it is now, in front of the server: what is looked at where the program was not built anew."""
        page = front(self.url)
        threading.Thread(target=page.serve_forever, daemon=True).start()
        return f"http://127.0.0.1:{page.server_port}"

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def back(self) -> None:
        self.start(self.url.removeprefix("http://"))

    def ask(self, method: str, path: str, body: Any = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        headers = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        request = urllib.request.Request(self.url + path, data, headers, method=method)
        with urllib.request.urlopen(request, timeout=120) as response:
            text = response.read()
        return json.loads(text) if text else None

    def ended(self, job: str) -> Any:
        for _ in range(3000):
            row = self.ask("GET", f"/v1/jobs/{job}")
            if row["state"] in ("succeeded", "failed", "cancelled"):
                return row
            time.sleep(0.1)
        raise AssertionError(f"{job} did not end: {row}")


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Server]]:
    """Starts servers, killed in the end."""
    servers: list[Server] = []

    def start(*arguments: str) -> Server:
        servers.append(Server(tmp_path / f"data-{len(servers)}", *arguments))
        return servers[-1]

    yield start
    for server in servers:
        server.kill()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if not found:
        pytest.skip("no Chromium: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox", "--disable-gpu"])
        yield browser
        browser.close()


class Sight:
    """A page, and what it asked for and complained about."""

    def __init__(self, context: BrowserContext, server: Server) -> None:
        self.server, self.asked, self.said = server, [], []  # type: ignore[var-annotated]
        context.set_default_timeout(PATIENCE)
        self.page: Page = context.new_page()
        self.page.on("request", lambda r: self.asked.append(r.url))
        self.page.on("pageerror", lambda e: self.said.append(str(e)))
        self.page.on("console", lambda m: self.said.append(m.text) if m.type in ("error", "warning") else None)

    def open(self, address: str = "#/") -> Page:
        self.page.goto(f"{self.server.page}/{address}")
        return self.page

    def check(self, expected: str = "Failed to load resource") -> None:
        """Nothing was asked of anybody else; the console has only refused requests, which browsers write there."""
        foreign = [u for u in self.asked if not u.startswith((self.server.page, "blob:", "data:"))]
        assert foreign == []
        assert [line for line in self.said if expected not in line] == []


@pytest.fixture
def see(browser: Browser) -> Iterator[Callable[..., Sight]]:
    """Opens the page of a server in a context of its own."""
    contexts: list[tuple[BrowserContext, Sight]] = []

    def open(server: Server, **options: Any) -> Sight:
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 900}, **options})
        contexts.append((context, Sight(context, server)))
        return contexts[-1][1]

    yield open
    for context, sight in contexts:
        sight.check()
        context.close()
