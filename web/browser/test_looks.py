"""Every view, at two widths and in both themes: no serious axe violations, and screenshots (stored with PICTURES=1)."""

import io
import os
from collections.abc import Callable
from typing import Any

import pytest
from conftest import ROOT
from PIL import Image
from playwright.sync_api import Page, expect
from test_diagnose import drop, with_report
from test_jobs import SHORT
from test_joints import TASK, load, recording
from test_train import prepare_comparison
from throws import LOW, csv, launches
from test_live import act

AXE = ROOT / "web/node_modules/axe-core/axe.min.js"
PICTURES = ROOT / "docs/pictures"
WIDTHS = {"wide": (1280, 900), "phone": (390, 844)}
#: Number of colours of a screenshot, and its maximum height, px.
COLOURS, TALLEST = 64, {"wide": 3000, "phone": 5500}
#: Maximum size of a screenshot, bytes; all are part of the repository.
LARGEST = 150_000


def prepare_play(page: Page, server: Any) -> None:
    """A task with an action, simulated, at half of its video."""
    page.locator(".badge.sim").wait_for()
    page.get_by_role("button", name="Run in the real world").click()
    page.locator(".badge.real").wait_for()
    page.get_by_label("Time").fill("1.6")


def prepare_jobs(page: Page, server: Any) -> None:
    page.locator("tbody tr").first.wait_for()


def prepare_job(page: Page, server: Any) -> None:
    page.locator(".result").wait_for()


def prepare_recording(page: Page, server: Any) -> None:
    """A recording of a pendulum, at half of its time."""
    _, text = recording(server)
    page.get_by_role("combobox", name="Mechanism").select_option(TASK)
    load(page, "Load a recording (CSV)", "log.csv", text)
    page.get_by_label("Time").fill("0.8")


def prepare_joints(page: Page, server: Any) -> None:
    """A diagnosis of a pendulum."""
    done = [job["id"] for job in server.request("GET", "/v1/jobs")["jobs"] if job["kind"] == "diagnose"]
    if not done:
        _, text = recording(server)
        tasks = server.request("GET", "/v1/control/tasks")["tasks"]
        scene = next(task["scene"] for task in tasks if task["name"] == TASK)
        done = [server.request("POST", "/v1/diagnoses", {"scene": scene, "trials": text})["id"]]
        server.wait_for_job(done[0])
    page.goto(f"{server.page}/#/joints/{done[0]}")
    page.locator("div.report").wait_for()


def prepare_pair(page: Page, server: Any) -> None:
    """Two estimations beside each other."""
    if len(server.request("GET", "/v1/jobs")["jobs"]) < 2:
        server.wait_for_job(server.request("POST", "/v1/iplw", {**SHORT, "rounds": 2, "seed": 3})["id"])
    page.evaluate("location.hash = '#/jobs?compare=job-1,job-2'")
    page.locator("circle.second").first.wait_for()


def prepare_tracks(page: Page, server: Any) -> None:
    """Tracks over a floor, as parsed."""
    drop(page, "throws.csv", csv(launches(14, 70, bounce=0.8, speeds=LOW)))
    page.locator(".note", has_text="floor").wait_for()


def prepare_diagnosis(page: Page, server: Any) -> None:
    """A diagnosis with a named effect, its report and its trials."""
    done = [job["id"] for job in server.request("GET", "/v1/jobs")["jobs"] if job["kind"] == "diagnose"]
    body = {"ball": {"radius": 0.02}, "trials": csv(launches(14, 70))}
    job = done[0] if done else server.request("POST", "/v1/diagnoses", body)["id"]
    server.wait_for_job(job)
    with_report(page).goto(f"{server.page}/#/diagnose/{job}")
    page.locator("[data-whole]").wait_for()
    page.get_by_text("Look at each trial").click()
    for canvas in page.locator("canvas").all():
        canvas.scroll_into_view_if_needed()
        page.wait_for_function("(c) => c.width !== 300", arg=canvas.element_handle())
    page.evaluate("scrollTo(0, 0)")


def prepare_draft(page: Page, server: Any) -> None:
    """A task in the editor, with a selected body, at half of its video."""
    page.locator(".stage .badge.sim").wait_for()
    page.get_by_role("button", name="green", exact=True).click()
    page.get_by_label("Time", exact=True).fill("1.6")


def prepare_form(page: Page, server: Any) -> None:
    page.locator("summary", has_text="More").click()


def prepare_estimation(page: Page, server: Any) -> None:
    """An estimation compared with another, with its worst trial at half of its video."""
    jobs = server.request("GET", "/v1/jobs")["jobs"]
    # Screenshots use a longer estimation than the accessibility checks.
    worth = {"rounds": 4, "actions": 3, "samples": 20, "residual": "shooting", "real": {"noise": 0.05}, "seed": 3}
    brief = {"rounds": 2, "actions": 2, "samples": 8, "seed": 1}
    fits: tuple[dict[str, Any], ...] = ({"strategy": "informative", "fit": ["linear_drag.c"]}, {"strategy": "mixed"})
    for fit in fits[len(jobs) - 1 :]:
        body = {"task": "bowling", **fit, **worth} if os.environ.get("PICTURES") else {"task": "basketball", **brief}
        jobs.append(server.wait_for_job(server.request("POST", "/v1/iplw", body)["id"]))
    one, other = (job["id"] for job in jobs[1:3])
    page.evaluate(f"location.hash = '#/calibrate/{one}?with={other}'")
    page.locator("circle.second").first.wait_for()
    page.locator(".gap").wait_for()
    page.get_by_label("Time").fill("1.6")


def prepare_proposals(page: Page, server: Any) -> None:
    """Proposals of an ask/tell estimation, one of them with the entry form open."""
    job = server.request("POST", "/v1/iplw", {**SHORT, "task": "basketball", "real": "ask_tell"})["id"]
    page.evaluate(f"location.hash = '#/calibrate/{job}'")
    page.locator("[data-proposal] summary").first.click()


def prepare_worlds(page: Page, server: Any) -> None:
    """Worlds used by programs."""
    for of in ({"task": "bowling"}, {"task": "basketball:004", "kind": "real", "budget": 20}, {"task": "bowling:017", "sealed": True}):
        world = server.request("POST", "/v1/worlds", of)["id"]
        act(server, world, [5, 9], None)
    page.locator("tbody tr").nth(6).wait_for()


def prepare_world(page: Page, server: Any) -> None:
    """A world used by a program, at half of a video."""
    page.get_by_text("Watching.").wait_for()
    act(server, "bowling-real", [[0.5, 0.9, 0.2]], "bowling:001")
    act(server, "bowling-real", [server.request("GET", "/v1/tasks/bowling/0")["certificate"]["action"]])
    page.locator(".stage .badge[data-verdict=solved]").wait_for()
    page.get_by_label("Time").fill("1.6")


def analysis(path: str, body: dict[str, Any], ready: str) -> Callable[[Page, Any], None]:
    """Prepares the page of a result, computed once for all screenshots, when an element is displayed."""

    def prepare(page: Page, server: Any) -> None:
        kind = path.removeprefix("/v1/").removesuffix("s")
        done = server.request("GET", f"/v1/jobs?kind={kind}&results=false")["jobs"]
        job = done[0]["id"] if done else server.request("POST", path, body)["id"]
        server.wait_for_job(job)
        page.goto(f"{server.page}/#/{kind}/{job}")
        page.locator(ready).first.wait_for()
        if kind == "plan":
            page.get_by_label("Time").fill("1.6")

    return prepare


def prepare_posterior(page: Page, server: Any) -> None:
    """The posterior of a few throws."""
    body = {"ball": {"radius": 0.02}, "trials": csv(launches(6, 30)), "sets": [["quadratic_drag"]], "draws": 512}
    analysis("/v1/posteriors", body, ".report")(page, server)


def prepare_start(page: Page, server: Any) -> None:
    page.locator("form").wait_for()
    page.locator(".recent, .aside .soft").last.wait_for()


PLAN = {"task": "bowling:003", "actions": 300, "draws": 16, "seed": 1}
DESIGN = {"task": "bowling:003", "batch": 2, "candidates": 40, "worlds": 16, "shortlist": 4, "seed": 1}
SURFACE = {"task": "bowling", "points": 3, "actions": 100, "seed": 1}

#: Name of the screenshot -> address, preparation.
VIEWS: dict[str, tuple[str, Callable[[Page, Any], None]]] = {
    "play": ("#/play/bowling:002", prepare_play),
    "play-basketball": ("#/play/basketball:003", prepare_play),
    "make": ("#/make?task=bowling:002", prepare_draft),
    "diagnose": ("#/diagnose", prepare_tracks),
    "diagnosis": ("#/diagnose", prepare_diagnosis),
    "joints": ("#/joints", prepare_recording),
    "joints-result": ("#/joints", prepare_joints),
    "calibrate": ("#/calibrate", prepare_form),
    "calibrate-run": ("#/calibrate", prepare_estimation),
    "calibrate-rig": ("#/calibrate", prepare_proposals),
    "posterior": ("#/posterior", prepare_start),
    "posterior-result": ("#/posterior", prepare_posterior),
    "plan": ("#/plan", prepare_start),
    "plan-result": ("#/plan", analysis("/v1/plans", PLAN, ".badge.sim")),
    "design": ("#/design", prepare_start),
    "design-result": ("#/design", analysis("/v1/designs", DESIGN, ".experiment svg")),
    "surface": ("#/surface", prepare_start),
    "surface-result": ("#/surface", analysis("/v1/surfaces", SURFACE, ".report")),
    "train": ("#/train/job-2", prepare_comparison),
    "jobs": ("#/jobs", prepare_jobs),
    "job": ("#/jobs/job-1", prepare_job),
    "jobs-compare": ("#/jobs", prepare_pair),
    "live": ("#/live", prepare_worlds),
    "live-world": ("#/live/bowling-real", prepare_world),
}


@pytest.mark.parametrize("name", VIEWS)
def test_view(name: str, serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    server.wait_for_job(server.request("POST", "/v1/iplw", SHORT)["id"])
    address, prepare = VIEWS[name]
    for theme in ("light", "dark"):
        for width, size in WIDTHS.items():
            options = {"viewport": {"width": size[0], "height": size[1]}, "color_scheme": theme}
            page = new_page(server, **options).open(address)
            prepare(page, server)
            expect(page.get_by_role("heading", level=1).first).to_be_visible()
            over = page.evaluate("document.documentElement.scrollWidth - innerWidth")
            assert over <= 0, f"{name} is {over} px wider than a {width} screen"
            assert violations(page) == [], f"{name}, {width}, {theme}"
            if os.environ.get("PICTURES"):
                save_screenshot(page, f"{name}-{width}-{theme}.png", TALLEST[width])


def save_screenshot(page: Page, name: str, tallest: int) -> None:
    """A screenshot of the page from its top, with a reduced palette."""
    page.evaluate("scrollTo(0, 0)")
    whole = Image.open(io.BytesIO(page.screenshot(full_page=True))).convert("RGB")
    part = whole.crop((0, 0, whole.width, min(whole.height, tallest)))
    PICTURES.mkdir(parents=True, exist_ok=True)
    few = part.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(PICTURES / name, optimize=True)
    size = (PICTURES / name).stat().st_size
    assert size <= LARGEST, f"{name} takes {size} bytes"


def violations(page: Page) -> list[str]:
    """Serious and critical violations reported by axe."""
    page.evaluate(AXE.read_text())
    found = page.evaluate("axe.run(document, { resultTypes: ['violations'] })")["violations"]
    bad = [v for v in found if v["impact"] in ("serious", "critical")]
    return [f"{v['id']}: {v['help']}: {n['html']} {n.get('failureSummary', '')}" for v in bad for n in v["nodes"]]
