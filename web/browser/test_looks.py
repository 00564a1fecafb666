"""Every view, in two widths and both themes: no serious finding of axe, and a picture (kept with PICTURES=1)."""

import os
from collections.abc import Callable
from typing import Any

import pytest
from conftest import ROOT
from playwright.sync_api import Page, expect
from test_jobs import SHORT
from test_train import compared

AXE = ROOT / "web/node_modules/axe-core/axe.min.js"
PICTURES = ROOT / "docs/pictures"
WIDTHS = {"wide": (1280, 900), "phone": (390, 844)}


def played(page: Page, server: Any) -> None:
    """A task placed, run and half way through its film."""
    page.locator(".badge.sim").wait_for()
    page.get_by_role("button", name="Run in the real world").click()
    page.locator(".badge.real").wait_for()
    page.get_by_label("Time").fill("1.6")


def listed(page: Page, server: Any) -> None:
    page.locator("tbody tr").first.wait_for()


def shown(page: Page, server: Any) -> None:
    page.locator(".result").wait_for()


#: A picture's name, the address, and what is done before it is taken.
VIEWS: dict[str, tuple[str, Callable[[Page, Any], None]]] = {
    "play": ("#/play/bowling:002", played),
    "play-basketball": ("#/play/basketball:003", played),
    "train": ("#/train/job-2", compared),
    "jobs": ("#/jobs", listed),
    "job": ("#/jobs/job-1", shown),
}


@pytest.mark.parametrize("name", VIEWS)
def test_view(name: str, serve: Callable[..., Any], see: Callable[..., Any]) -> None:
    server = serve()
    server.ended(server.ask("POST", "/v1/iplw", SHORT)["id"])
    address, prepare = VIEWS[name]
    for theme in ("light", "dark"):
        for width, size in WIDTHS.items():
            options = {"viewport": {"width": size[0], "height": size[1]}, "color_scheme": theme}
            page = see(server, **options).open(address)
            prepare(page, server)
            expect(page.locator("h1")).to_be_visible()
            over = page.evaluate("document.documentElement.scrollWidth - innerWidth")
            assert over <= 0, f"{name} is {over} px wider than a {width} screen"
            assert findings(page) == [], f"{name}, {width}, {theme}"
            if os.environ.get("PICTURES"):
                PICTURES.mkdir(parents=True, exist_ok=True)
                page.screenshot(path=PICTURES / f"{name}-{width}-{theme}.png", full_page=True)


def findings(page: Page) -> list[str]:
    """What axe finds serious or critical."""
    page.evaluate(AXE.read_text())
    found = page.evaluate("axe.run(document, { resultTypes: ['violations'] })")["violations"]
    bad = [v for v in found if v["impact"] in ("serious", "critical")]
    return [f"{v['id']}: {v['help']}: {n['html']} {n.get('failureSummary', '')}" for v in bad for n in v["nodes"]]
