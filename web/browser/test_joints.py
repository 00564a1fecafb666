"""Joints: a mechanism is drawn and edited, a recording of it plays, and its diagnosis names the missing effect."""

import math
import re
from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page, expect

#: Step of the scene's recording, s; friction of the recorded hinge, N m s.
INTERVAL, FRICTION = 0.02, 0.05
#: Pendulum of the built-in swing-up task: see `GET /v1/control/tasks`.
TASK = "pendulum_swing_up"


def recording(server: Any) -> tuple[str, str]:
    """Name of the hinge, and a recording of the built-in pendulum with viscous friction that its scene lacks."""
    physics = {"effects": []}
    task = next(t for t in server.request("GET", "/v1/control/tasks")["tasks"] if t["name"] == TASK)
    joint = task["joints"][0]
    physics = {"effects": [{"joint": joint, "name": "viscous_friction", "parameters": {"b": FRICTION}}]}
    definition = {"task": TASK, "kind": "sim", "seed": 3, "physics": physics, "count": 6}
    world = server.request("POST", "/v1/control/worlds", definition)["id"]
    position = server.request("POST", f"/v1/control/worlds/{world}/reset", {"seed": 3})["position"]
    low, high = task["actions"][0]["low"], task["actions"][0]["high"]
    rows: list[list[str]] = [[] for _ in range(6)]
    for k in range(80):
        share = [0.9 * math.sin(0.17 * k * (1 + 0.2 * i) + i) for i in range(6)]
        actions = [[(low + high) / 2 + (high - low) / 2 * s] for s in share]
        for i in range(6):
            rows[i].append(f"{i},{k * task['interval']:.6f},{position[i][0]!r},{actions[i][0]!r}")
        step = server.request("POST", f"/v1/control/worlds/{world}/step", {"actions": actions})
        position = step["position"]
    lines = [f"trial,t,{joint},{joint}.command", *(line for own in rows for line in own)]
    return joint, "\n".join(lines) + "\n"


def load(page: Page, label: str, name: str, text: str) -> None:
    page.get_by_label(label).set_input_files({"name": name, "mimeType": "text/plain", "buffer": text.encode()})


def test_a_recorded_mechanism_is_diagnosed(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    joint, csv = recording(server)
    page = new_page(server).open("#/joints")
    page.get_by_role("combobox", name="Mechanism").select_option(TASK)
    expect(page.locator("svg.scene .joint-mark")).to_have_count(1)
    expect(page.get_by_role("button", name="Run the diagnosis")).to_be_disabled()
    # The drawing follows the edited initial position.
    body = page.locator("svg.scene g[transform]").last
    before = page.locator("svg.scene").inner_html()
    page.get_by_label("Initial position").fill("1.2")
    expect(body).to_be_attached()
    assert page.locator("svg.scene").inner_html() != before
    # A recording of another mechanism is refused with the columns that this one has.
    load(page, "Load a recording (CSV)", "other.csv", "trial,t,knee\n0,0,0\n")
    expect(page.locator(".error")).to_contain_text(f"trial, t, {joint}")
    load(page, "Load a recording (CSV)", "log.csv", csv)
    expect(page.get_by_text(f"{joint}: measured position")).to_be_visible()
    expect(page.get_by_text(f"{joint}: command")).to_be_visible()
    page.get_by_role("button", name="Play").click()
    page.get_by_role("button", name="Run the diagnosis").click()
    expect(page).to_have_url(re.compile("#/joints/job-"))
    report = page.locator(".report")
    expect(report.get_by_role("heading", name=f"The simulation lacks viscous friction in {joint}")).to_be_visible()
    expect(report.get_by_text("tau = -b v").first).to_be_visible()
    expect(report.locator("svg").first).to_be_visible()
    expect(page.get_by_role("button", name="Save the extended scene")).to_be_visible()
    # The same job as a link of the list of jobs.
    page.goto(re.sub("#/joints/", "#/diagnose/", page.url))
    expect(page).to_have_url(re.compile("#/joints/job-"))
