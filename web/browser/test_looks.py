"""Every view, in two widths and both themes: no serious finding of axe, and a picture (kept with PICTURES=1)."""

import os
from collections.abc import Callable
from typing import Any

import pytest
from conftest import ROOT
from playwright.sync_api import Page, expect
from test_diagnose import drop
from test_jobs import SHORT
from test_train import compared
from thrown import LOW, csv, launches

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


def tracked(page: Page, server: Any) -> None:
    """Tracks over a floor, as they will be read."""
    drop(page, "throws.csv", csv(launches(14, 70, bounce=0.8, speeds=LOW)))
    page.locator(".told").wait_for()


def diagnosed(page: Page, server: Any) -> None:
    """A diagnosis that named an effect, with all of its plots drawn."""
    done = [job["id"] for job in server.ask("GET", "/v1/jobs")["jobs"] if job["kind"] == "diagnose"]
    body = {"ball": {"radius": 0.02}, "trials": csv(launches(14, 70))}
    job = done[0] if done else server.ask("POST", "/v1/diagnoses", body)["id"]
    server.ended(job)
    page.goto(f"{server.page}/#/diagnose/{job}")
    page.locator("[data-whole]").wait_for()
    for canvas in page.locator("canvas").all():
        canvas.scroll_into_view_if_needed()
        page.wait_for_function("(c) => c.width !== 300", arg=canvas.element_handle())
    page.evaluate("scrollTo(0, 0)")


def drafted(page: Page, server: Any) -> None:
    """A task as a draft, with a body selected and the film half way."""
    page.locator(".stage .badge.sim").wait_for()
    page.get_by_role("button", name="green", exact=True).click()
    page.get_by_label("Time", exact=True).fill("1.6")


#: A picture's name, the address, and what is done before it is taken.
VIEWS: dict[str, tuple[str, Callable[[Page, Any], None]]] = {
    "play": ("#/play/bowling:002", played),
    "play-basketball": ("#/play/basketball:003", played),
    "make": ("#/make?task=bowling:002", drafted),
    "diagnose": ("#/diagnose", tracked),
    "diagnosis": ("#/diagnose", diagnosed),
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
