"""Every view, in two widths and both themes: no serious finding of axe, and a picture (kept with PICTURES=1)."""

import io
import os
from collections.abc import Callable
from typing import Any

import pytest
from conftest import ROOT
from PIL import Image
from playwright.sync_api import Page, expect
from test_diagnose import drop
from test_jobs import SHORT
from test_train import compared
from thrown import LOW, csv, launches
from test_live import act

AXE = ROOT / "web/node_modules/axe-core/axe.min.js"
PICTURES = ROOT / "docs/pictures"
WIDTHS = {"wide": (1280, 900), "phone": (390, 844)}
#: Of a picture: colours, and height as far as which a view is kept, px.
COLOURS, TALLEST = 64, {"wide": 3000, "phone": 5500}
#: Bytes of a picture, at most: who fetches the project fetches all of them.
LARGEST = 150_000


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


def started(page: Page, server: Any) -> None:
    page.locator("summary", has_text="More").click()


def calibrated(page: Page, server: Any) -> None:
    """A run laid over another one, and its worst trial half way through its film."""
    jobs = server.ask("GET", "/v1/jobs")["jobs"]
    # A picture is of an estimation that is worth looking at; accessibility does not take that long.
    worth = {"rounds": 4, "actions": 3, "samples": 20, "residual": "shooting", "real": {"noise": 0.05}, "seed": 3}
    brief = {"rounds": 2, "actions": 2, "samples": 8, "seed": 1}
    fits: tuple[dict[str, Any], ...] = ({"strategy": "informative", "fit": ["linear_drag.c"]}, {"strategy": "mixed"})
    for fit in fits[len(jobs) - 1 :]:
        body = {"task": "bowling", **fit, **worth} if os.environ.get("PICTURES") else {"task": "basketball", **brief}
        jobs.append(server.ended(server.ask("POST", "/v1/iplw", body)["id"]))
    one, other = (job["id"] for job in jobs[1:3])
    page.evaluate(f"location.hash = '#/calibrate/{one}?with={other}'")
    page.locator("circle.second").first.wait_for()
    page.locator(".gap").wait_for()
    page.get_by_label("Time").fill("1.6")


def asked(page: Page, server: Any) -> None:
    """A rig's proposals, one of them being filled in."""
    job = server.ask("POST", "/v1/iplw", {**SHORT, "task": "basketball", "real": "ask_tell"})["id"]
    page.evaluate(f"location.hash = '#/calibrate/{job}'")
    page.locator("[data-proposal] summary").first.click()


def peopled(page: Page, server: Any) -> None:
    """Worlds that programs act in."""
    for of in ({"task": "bowling"}, {"task": "basketball:004", "kind": "real", "budget": 20}, {"task": "bowling:017", "sealed": True}):
        world = server.ask("POST", "/v1/worlds", of)["id"]
        act(server, world, [5, 9], None)
    page.locator("tbody tr").nth(6).wait_for()


def acted(page: Page, server: Any) -> None:
    """A world that a program acts in, half way through a film."""
    page.get_by_text("Watching.").wait_for()
    act(server, "bowling-real", [[0.5, 0.9, 0.2]], "bowling:001")
    act(server, "bowling-real", [server.ask("GET", "/v1/tasks/bowling/0")["certificate"]["action"]])
    page.locator(".stage .badge[data-verdict=solved]").wait_for()
    page.get_by_label("Time").fill("1.6")


#: A picture's name, the address, and what is done before it is taken.
VIEWS: dict[str, tuple[str, Callable[[Page, Any], None]]] = {
    "play": ("#/play/bowling:002", played),
    "play-basketball": ("#/play/basketball:003", played),
    "make": ("#/make?task=bowling:002", drafted),
    "diagnose": ("#/diagnose", tracked),
    "diagnosis": ("#/diagnose", diagnosed),
    "calibrate": ("#/calibrate", started),
    "calibrate-run": ("#/calibrate", calibrated),
    "calibrate-rig": ("#/calibrate", asked),
    "train": ("#/train/job-2", compared),
    "jobs": ("#/jobs", listed),
    "job": ("#/jobs/job-1", shown),
    "live": ("#/live", peopled),
    "live-world": ("#/live/bowling-real", acted),
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
                keep(page, f"{name}-{width}-{theme}.png", TALLEST[width])


def keep(page: Page, name: str, tallest: int) -> None:
    """A picture of the page from its top, with few colours, for there are few on it."""
    page.evaluate("scrollTo(0, 0)")
    whole = Image.open(io.BytesIO(page.screenshot(full_page=True))).convert("RGB")
    part = whole.crop((0, 0, whole.width, min(whole.height, tallest)))
    PICTURES.mkdir(parents=True, exist_ok=True)
    few = part.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(PICTURES / name, optimize=True)
    size = (PICTURES / name).stat().st_size
    assert size <= LARGEST, f"{name} takes {size} bytes"


def findings(page: Page) -> list[str]:
    """What axe finds serious or critical."""
    page.evaluate(AXE.read_text())
    found = page.evaluate("axe.run(document, { resultTypes: ['violations'] })")["violations"]
    bad = [v for v in found if v["impact"] in ("serious", "critical")]
    return [f"{v['id']}: {v['help']}: {n['html']} {n.get('failureSummary', '')}" for v in bad for n in v["nodes"]]
