"""The built site in Chromium, from files and from a server: search works, no external requests, no errors."""

from __future__ import annotations

import functools
import http.server
import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect, sync_playwright

SITE = Path(__file__).resolve().parents[2] / "out" / "site"
PAGES = ["index.html", "http/worlds.html", "explanation/architecture.html"]


class SilentHandler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    result = shutil.which("chromium")
    if result is None:
        assert os.environ.get("CI") != "true", "no Chromium (apt-get install chromium)"
        pytest.skip("no Chromium")
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=result, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(params=["file", "http"])
def base(request: pytest.FixtureRequest) -> Iterator[str]:
    if request.param == "file":
        yield SITE.as_uri()
        return
    handler = functools.partial(SilentHandler, directory=str(SITE))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_search_works_without_external_requests(browser: Browser, base: str) -> None:
    page = browser.new_page()
    requested: list[str] = []
    errors: list[str] = []
    page.on("request", lambda request: requested.append(request.url))
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    for name in PAGES:
        page.goto(f"{base}/{name}", wait_until="load")
    page.goto(f"{base}/python/index.html")
    page.get_by_placeholder("Search").click()
    page.keyboard.type("set_latents")
    expect(page.locator(".md-search-result__meta")).to_contain_text("matching document", timeout=30_000)
    assert page.locator(".md-search-result__item").count() >= 3
    page.close()
    local = (base, "data:", "blob:", "about:")
    assert [url for url in requested if not url.startswith(local)] == []
    assert errors == []


def test_diagrams_match_the_color_scheme(browser: Browser) -> None:
    for scheme in ("light", "dark"):
        page = browser.new_page(color_scheme=scheme)
        page.goto(f"{SITE.as_uri()}/explanation/architecture.html")
        displayed = page.locator("img[src*='diagrams/']").and_(page.locator(":visible"))
        expect(displayed).to_have_count(1)
        assert f"-{scheme}.svg" in str(displayed.get_attribute("src"))
        assert displayed.evaluate("image => image.naturalWidth") > 0
        page.close()
