"""Make: a scene is drawn by mouse and keyboard, simulated while drawing, saved, and created as a world with curl."""

import importlib.util
import json
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Locator, Page, expect

DROP = {
    "format": "iplw.scene/1",
    "name": "drop",
    "gravity": [0, -9.81],
    "bodies": [
        {"name": "ball", "shape": {"type": "disc", "radius": 0.2}, "mass": 0.3, "position": [0, 2]},
        {
            "name": "hammer",
            "shape": {
                "type": "compound",
                "pieces": [
                    {"type": "box", "half_width": 0.1, "half_height": 0.5},
                    {"type": "box", "half_width": 0.4, "half_height": 0.1, "position": [0, 0.5], "angle": 0.1},
                ],
            },
            "position": [2, 2],
        },
    ],
    "statics": [
        {"name": "ground", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}},
        {"name": "ramp", "shape": {"type": "segment", "from": [-3, 1], "to": [-1, 0.5]}, "friction": 0.9},
    ],
    "effects": [{"name": "quadratic_drag", "parameters": {"k": 0.13}}],
    "time_step": 0.004,
    "steps": 500,
    "calibrate": ["restitution"],
    "per_setting": ["lift"],
    "settings": {"slow": {"bodies": {"ball": {"mass": 0.0027}}}},
}


def stage(page: Page) -> Locator:
    return page.locator(".stage > svg.scene")


def tool(page: Page, name: str) -> None:
    page.get_by_role("group", name="Tools").get_by_role("button", name=name, exact=True).click()


def verdict(page: Page) -> Locator:
    return page.locator(".stage .badge.sim")


def point(page: Page, x: float, y: float) -> tuple[float, float]:
    """Screen coordinates of a world position."""
    at = page.evaluate(
        """([x, y]) => {
          const p = new DOMPoint(x, y).matrixTransform(document.querySelector('.stage svg.scene > g').getScreenCTM());
          return [p.x, p.y];
        }""",
        [x, y],
    )
    return at[0], at[1]


def drag(page: Page, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Drags the mouse between two world positions."""
    a, b = point(page, *start), point(page, *end)
    page.mouse.move(*a)
    page.mouse.down()
    page.mouse.move((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)
    page.mouse.move(*b)
    page.mouse.up()


def save(page: Page, folder: Path) -> Any:
    """The file written by Save."""
    with page.expect_download() as waiting:
        page.get_by_role("button", name="Save", exact=True).click()
    file = folder / waiting.value.suggested_filename
    waiting.value.save_as(file)
    return json.loads(file.read_text())


def open_file(page: Page, folder: Path, scene: Any) -> None:
    file = folder / "given.json"
    file.write_text(json.dumps(scene))
    page.locator("input[type=file]").set_input_files(file)


def drop_file(page: Page, scene: Any) -> None:
    """Drops a file onto the view."""
    page.evaluate(
        """(text) => {
          const dataTransfer = new DataTransfer();
          dataTransfer.items.add(new File([text], "dropped.json"));
          document.querySelector(".stage svg.scene").dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true, cancelable: true }));
        }""",
        json.dumps(scene),
    )


def test_a_scene_is_drawn_simulated_saved_and_created_as_a_world(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Path) -> None:
    server = serve()
    page = new_page(server, permissions=["clipboard-read", "clipboard-write"]).open("#/make")
    stage(page).wait_for()
    page.get_by_label("Name").fill("roll")
    tool(page, "Segment")
    drag(page, (-4, 1), (4, 0))
    page.get_by_label("Name").fill("slope")
    tool(page, "Disc")
    drag(page, (-3, 3), (-3, 3.5))
    page.get_by_label("Name").fill("ball")
    expect(verdict(page)).to_contain_text("no goal")
    assert page.locator(".stage .trail").count() == 1
    tool(page, "Goal region")
    drag(page, (1, -1), (5, 3))
    expect(page.get_by_label("Body", exact=True)).to_have_value("ball")
    expect(verdict(page)).to_contain_text("Goal reached")
    page.get_by_role("button", name="ball", exact=True).click()
    tool(page, "Action area")
    drag(page, (-3.5, 2.5), (-1, 5))
    expect(page.locator(".scene .area")).to_have_count(1)
    expect(page.get_by_label("High of component 1")).to_have_value("-1")
    scene = save(page, tmp_path)
    assert (tmp_path / "roll.json").exists()
    assert [b["name"] for b in scene["bodies"] + scene["statics"]] == ["ball", "slope"]
    world = server.request("POST", "/v1/worlds", {"scene": scene})["id"]
    server.request("POST", f"/v1/worlds/{world}/reset", {})
    step = server.request("POST", f"/v1/worlds/{world}/step", {"action": [0.5, 0.5]})
    assert step["info"]["valid"] and step["terminated"]
    # The copied commands have the same effect.
    page.get_by_role("button", name="Copy as curl").click()
    expect(page.get_by_text("Copied: a world of this scene, as curl.")).to_be_visible()
    command = page.evaluate("navigator.clipboard.readText()")
    made = json.loads(subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=True).stdout)
    assert made["task"] == "custom:roll", shlex.quote(command)
    page.get_by_role("button", name="Copy as Python").click()
    expect(page.get_by_text("Copied: a world of this scene, as Python.")).to_be_visible()
    program = page.evaluate("navigator.clipboard.readText()")
    compile(program, "copied", "exec")
    if importlib.util.find_spec("iplw"):
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        assert "'valid': True" in done.stdout
    page.get_by_role("group", name="File").get_by_role("button", name="Play").click()
    expect(page.locator("h1")).to_have_text("Play")
    expect(page.locator(".badge.sim")).to_have_text("Simulation: solved")
    page.get_by_role("link", name="Make").click()
    undo = page.get_by_role("button", name="Undo")
    expect(undo).to_be_enabled()
    undo.click()
    expect(page.locator(".scene .area")).to_have_count(0)


def test_a_lost_connection_is_displayed_and_the_draft_is_simulated_after_a_restart(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Path) -> None:
    server = serve()
    page = new_page(server).open("#/make")
    stage(page).wait_for()
    open_file(page, tmp_path, DROP)
    expect(verdict(page)).to_contain_text("no goal")
    server.kill()
    stage(page).focus()
    page.keyboard.press("n")
    page.keyboard.press("ArrowUp")
    expect(page.locator(".banner")).to_be_visible()
    expect(verdict(page)).to_be_hidden()
    server.restart()
    expect(page.locator(".banner")).to_be_hidden()
    expect(verdict(page)).to_contain_text("no goal")
    assert save(page, tmp_path)["bodies"][0]["position"][1] > 2


def test_undo_redo_and_reload_preserve_the_draft(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Path) -> None:
    page = new_page(serve()).open("#/make")
    stage(page).wait_for()
    tool(page, "Box")
    drag(page, (0, 1), (1, 2))
    x = page.get_by_label("x m", exact=True)
    expect(x).to_have_value("0.5")
    drag(page, (0.5, 1.5), (2.5, 1.5))
    expect(x).to_have_value("2.5")
    # Corner handles scale, the upper handle rotates.
    drag(page, (3, 2), (4, 3))
    expect(page.get_by_label("Half width")).to_have_value("1")
    handle = page.locator(".handle.turn").bounding_box()
    assert handle
    page.mouse.move(handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2)
    page.mouse.down()
    page.mouse.move(*point(page, 6, 2))
    page.mouse.move(*point(page, 7, 2))
    page.mouse.up()
    expect(page.get_by_label("Angle")).to_have_value("-1.57")
    expect(x).to_have_value("3")
    after = save(page, tmp_path)
    undo, redo = page.get_by_role("button", name="Undo"), page.get_by_role("button", name="Redo")
    for _ in range(3):
        undo.click()
    expect(x).to_have_value("0.5")
    expect(page.get_by_label("Half width")).to_have_value("0.5")
    undo.click()
    expect(undo).to_be_disabled()
    assert save(page, tmp_path)["bodies"] == []
    for _ in range(4):
        redo.click()
    expect(redo).to_be_disabled()
    page.reload()
    page.get_by_role("button", name="box", exact=True).click()
    expect(x).to_have_value("3")
    assert save(page, tmp_path) == after


def test_an_invalid_value_displays_the_servers_message_at_its_field(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Path) -> None:
    page = new_page(serve()).open("#/make")
    stage(page).wait_for()
    open_file(page, tmp_path, DROP)
    expect(verdict(page)).to_contain_text("no goal")
    page.get_by_role("button", name="ball", exact=True).click()
    friction = page.get_by_label("Friction")
    friction.fill("-1")
    expect(friction).to_have_attribute("aria-invalid", "true")
    message = page.locator(f"#{friction.get_attribute('aria-describedby')}")
    expect(message).to_contain_text("`scene.bodies[0].friction` is -1")
    friction.fill("0.5")
    expect(page.locator("[aria-invalid]")).to_have_count(0)
    # If another object is selected, a button leads to the field.
    page.get_by_role("button", name="Goal", exact=True).click()
    page.get_by_label("Goal", exact=True).select_option("contact")
    page.get_by_label("Held for").fill("99")
    page.get_by_role("button", name="World", exact=True).click()
    expect(page.locator(".problem")).to_contain_text("scene.goal.hold_s")
    page.get_by_role("button", name="Go to goal").click()
    expect(page.get_by_label("Held for")).to_be_focused()
    expect(page.get_by_label("Held for")).to_have_attribute("aria-invalid", "true")
    page.get_by_label("Held for").fill("0")
    page.get_by_role("button", name="Effects", exact=True).click()
    page.get_by_label("Effect", exact=True).select_option("wind")
    page.get_by_role("button", name="Add effect").click()
    page.get_by_label("ax of wind").fill("1000")
    expect(page.get_by_label("ax of wind")).to_have_attribute("aria-invalid", "true")
    expect(page.locator(".problem")).to_contain_text("effects[1].parameters.ax")
    page.get_by_label("ax of wind").fill("10")
    expect(page.locator(".problem")).to_be_hidden()
    # After opening a file, the field of the first error is focused.
    open_file(page, tmp_path, {**DROP, "bodies": [{**DROP["bodies"][0], "position": [0, 0.1]}]})
    expect(page.locator(".form h2")).to_have_text("ball")
    expect(page.get_by_label("y m", exact=True)).to_have_attribute("aria-invalid", "true")


def test_an_invalid_file_is_reported_and_a_valid_one_preserved(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Path) -> None:
    page = new_page(serve()).open("#/make")
    stage(page).wait_for()
    notes = tmp_path / "notes.json"
    notes.write_text("x = 1")
    chooser = page.locator("input[type=file]")
    chooser.set_input_files(notes)
    expect(page.locator(".error")).to_contain_text("notes.json: It is not JSON")
    open_file(page, tmp_path, {**DROP, "bodies": [{"name": "ball", "shape": {"type": "ball"}}]})
    expect(page.locator(".error")).to_contain_text("unknown variant `ball`")
    drop_file(page, DROP)
    expect(verdict(page)).to_contain_text("no goal")
    expect(page.locator(".error")).to_have_count(0)
    assert save(page, tmp_path) == DROP
    # Fields without a form are preserved by edits; references follow renames.
    page.get_by_role("button", name="ball", exact=True).click()
    page.get_by_label("Name").fill("hammer")
    expect(page.get_by_text('Another object is named "hammer".')).to_be_visible()
    page.get_by_label("Name").fill("puck")
    page.get_by_label("Restitution").fill("0.25")
    after = save(page, tmp_path)
    assert after["settings"] == {"slow": {"bodies": {"puck": {"mass": 0.0027}}}}
    assert after["bodies"][0] == {**DROP["bodies"][0], "name": "puck", "restitution": 0.25}
    assert {k: v for k, v in after.items() if k not in ("bodies", "settings")} == {k: v for k, v in DROP.items() if k not in ("bodies", "settings")}


def test_automatic_simulation_can_be_disabled_and_a_task_is_edited(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Path) -> None:
    server = serve()
    page = new_page(server).open("#/make")
    stage(page).wait_for()
    page.get_by_role("button", name="Choose a task").click()
    page.get_by_role("button", name="basketball:003").click()
    expect(verdict(page)).to_contain_text("Goal")
    task = server.request("GET", "/v1/tasks/basketball/3")["scene"]
    assert save(page, tmp_path) == task
    # A valid action is searched for, another one on request; a moved object stays at its new position.
    before = page.locator(".acting").inner_text()
    page.get_by_role("button", name="Try another action").click()
    expect(page.locator(".acting")).not_to_have_text(before)
    page.get_by_label("Run as you draw").uncheck()
    expect(verdict(page)).to_be_hidden()
    tool(page, "Polygon")
    for corner in ((30, 20), (36, 20), (33, 26)):
        page.mouse.click(*point(page, *corner))
    page.mouse.click(*point(page, 30, 20))
    expect(page.locator(".form h2")).to_have_text("polygon")
    page.get_by_label("Kind").select_option("statics")
    expect(page.locator(".form h2")).to_have_text("polygon")
    expect(verdict(page)).to_be_hidden()
    page.get_by_role("button", name="Run", exact=True).click()
    expect(verdict(page)).to_contain_text("Goal")
    after = save(page, tmp_path)
    assert {**after, "statics": after["statics"][:-1]} == task
    assert after["statics"][-1]["shape"]["type"] == "polygon"


def test_a_body_is_added_and_moved_by_keyboard(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Path) -> None:
    page = new_page(serve()).open("#/make")
    stage(page).focus()
    for key in ("s", "Enter", "d", "Enter"):
        page.keyboard.press(key)
    expect(page.locator(".form h2")).to_have_text("disc")
    x, y = page.get_by_label("x m", exact=True), page.get_by_label("y m", exact=True)
    expect(x).to_have_value("0")
    before = float(y.input_value())
    for key in ("ArrowUp", "ArrowUp", "ArrowRight", "+", "r"):
        page.keyboard.press(key)
    assert float(y.input_value()) > before and float(x.input_value()) > 0
    radius = float(page.get_by_label("Radius").input_value())
    expect(verdict(page)).to_contain_text("Ran")
    page.keyboard.press("Enter")
    expect(page.get_by_label("Name")).to_be_focused()
    stage(page).focus()
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    assert float(page.get_by_label("Radius").input_value()) < radius
    page.keyboard.press("Delete")
    page.keyboard.press("n")
    expect(page.locator(".form h2")).to_have_text("segment")
    assert save(page, tmp_path)["bodies"] == []
