"""Play: a task is solved by mouse; displaying it spends no interactions."""

import json
import re
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Locator, Page, expect

FILMS = "Number(document.querySelector('.stage svg.scene').dataset.film ?? 0)"


def stage(page: Page) -> Locator:
    return page.locator(".stage > svg.scene")


def film(page: Page) -> int:
    """Waits for a video and returns its number."""
    expect(page.locator(".badge.sim")).to_be_visible()
    return int(page.evaluate(FILMS))


def point(page: Page, x: float, y: float) -> tuple[float, float]:
    """Screen coordinates of a world position, which is scrolled into view."""
    stage(page).scroll_into_view_if_needed()
    at = page.evaluate(
        """([x, y]) => {
          const p = new DOMPoint(x, y).matrixTransform(document.querySelector('.stage svg.scene > g').getScreenCTM());
          return [p.x, p.y];
        }""",
        [x, y],
    )
    return at[0], at[1]


def trails(page: Page) -> list[str]:
    lines = page.locator(".stage .trail:not(.real)").all()
    return [line.get_attribute("points") or "" for line in lines]


def spent(page: Page) -> str:
    return page.locator(".tally .count").inner_text()


def test_a_bowling_task_is_solved_by_mouse(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    task = server.request("GET", "/v1/tasks/bowling/0")
    space = task["scene"]["action"]["components"]
    x, y, radius = (c["low"] + a * (c["high"] - c["low"]) for c, a in zip(space, task["certificate"]["action"], strict=True))
    page = new_page(server).open("#/play/bowling:001")
    film(page)
    page.get_by_role("button", name="Choose a task").click()
    page.get_by_role("button", name="bowling:000").click()
    expect(page.locator(".play-head strong").first).to_have_text("bowling:000")
    film(page)
    page.get_by_label("red radius").fill(str(round(task["certificate"]["action"][2], 3)))
    # A click places the object, and a drag moves it.
    page.mouse.click(*point(page, x + 3, y))
    page.mouse.move(*point(page, x + 3, y))
    page.mouse.down()
    page.mouse.move(*point(page, x + 1, y))
    page.mouse.move(*point(page, x, y))
    page.mouse.up()
    goal = page.locator(".goal-row")
    expect(goal).to_contain_text("Goal: green and blue touch for 3 s.")
    expect(goal).to_contain_text(re.compile(r"Simulation: (solved\s*at|not solved\s*in) [\d.]+ s"))
    assert spent(page) == "0"
    page.get_by_role("button", name="Run in the real world").click()
    expect(page.locator(".badge.real")).to_have_text("Reality: solved")
    expect(page.locator(".tally .count")).to_have_text("1")
    expect(page.locator(".gap")).to_be_visible()
    expect(page.locator(".tally")).to_contain_text("hidden")
    # Displaying spends no interactions.
    page.get_by_role("button", name="Pause").click()
    page.get_by_label("Time").fill("1.5")
    page.get_by_label("friction").fill("0.2")
    film(page)
    assert spent(page) == "1"
    assert server.request("GET", "/v1/worlds/bowling-real")["interactions"] == 1


def test_dragging_a_latent_updates_the_video(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = new_page(serve()).open()
    film(page)
    page.wait_for_function("() => document.querySelector('.stage .shade').getAttribute('d')")
    before, seen = trails(page), film(page)
    slider = page.get_by_label("restitution").bounding_box()
    assert slider
    page.mouse.move(slider["x"] + slider["width"] / 2, slider["y"] + slider["height"] / 2)
    page.mouse.down()
    for step in range(1, 11):
        page.mouse.move(slider["x"] + slider["width"] * (0.5 + 0.04 * step), slider["y"] + slider["height"] / 2)
    page.wait_for_function(f"() => {FILMS} > {seen}")
    during = trails(page)
    page.mouse.up()
    assert during != before
    took = page.evaluate(
        """async () => {
          const svg = document.querySelector('.stage svg.scene');
          const slider = [...document.querySelectorAll('.slider')].find((e) => e.textContent.startsWith('friction')).querySelector('input');
          const took = [];
          for (let i = 0; i < 40; i++) {
            const redrawn = new Promise((done) => new MutationObserver((_, o) => (o.disconnect(), done())).observe(svg, { attributes: true, attributeFilter: ['data-film'] }));
            const begun = performance.now();
            slider.value = String(0.2 + i / 100);
            slider.dispatchEvent(new Event('input'));
            await redrawn;
            took.push(performance.now() - begun);
          }
          return took;
        }"""
    )
    print(f"slider to new film, bowling, 4000 steps: {statistics.median(took):.1f} ms median of {len(took)}")
    assert spent(page) == "0"


def test_invalid_placements_are_shaded_and_explained(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open()
    film(page)
    scene = server.request("GET", "/v1/tasks/bowling/0")["scene"]
    page.mouse.click(*point(page, *scene["bodies"][0]["position"]))
    expect(page.locator(".refused-why")).to_contain_text("overlaps green")
    expect(page.get_by_role("button", name="Run in the real world")).to_be_disabled()
    assert server.request("GET", "/v1/worlds/bowling-real")["interactions"] == 0


def test_play_is_operable_by_keyboard(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = new_page(serve()).open()
    film(page)
    x = page.get_by_label("red x")
    before = float(x.input_value())
    stage(page).focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    page.keyboard.press("Control+ArrowLeft")
    assert abs(float(x.input_value()) - before - 3 * 0.02 + 0.002) < 0.002
    run = page.get_by_role("button", name="Run in the real world")
    expect(run).to_be_enabled()
    run.focus()
    page.keyboard.press("Enter")
    expect(page.locator(".tally .count")).to_have_text("1")
    page.get_by_label("Effect", exact=True).select_option("wind")
    page.get_by_role("button", name="Add").press("Enter")
    expect(page.locator("fieldset.effect")).to_contain_text("a = (ax, ay)")
    page.get_by_role("button", name="Keys").press("Enter")
    expect(page.get_by_role("dialog", name="Keys and pointer")).to_contain_text("Shift and arrow keys")
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog", name="Keys and pointer")).to_be_hidden()


def test_a_scene_file_is_played_and_an_invalid_one_reported(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Path) -> None:
    page = new_page(serve()).open()
    film(page)
    wrong, bad, good = tmp_path / "notes.json", tmp_path / "bad.json", tmp_path / "drop.json"
    wrong.write_text("x = 1")
    scene = {
        "format": "iplw.scene/1",
        "name": "drop",
        "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 2]}],
        "statics": [{"name": "floor", "shape": {"type": "segment", "from": [-2, 0], "to": [2, 0]}}],
        "steps": 480,
    }
    good.write_text(json.dumps(scene))
    bad.write_text(json.dumps({**scene, "bodies": [{**scene["bodies"][0], "friction": -1}]}))
    chooser = page.locator("input[type=file]")
    chooser.set_input_files(wrong)
    expect(page.locator(".error")).to_contain_text("is not JSON")
    chooser.set_input_files(bad)
    expect(page.locator(".error")).to_contain_text("scene.bodies[0].friction")
    chooser.set_input_files(good)
    expect(page.locator(".badge.sim")).to_have_text("Simulation: no goal")
    expect(page.locator(".reality")).to_contain_text("no real world")
    assert len(trails(page)) == 1
    page.get_by_role("button", name="Open bowling:000").click()
    expect(page.locator(".goal-row")).to_contain_text("green and blue touch")


#: A ball over a floor with two effects of its own and a term of an empirical field.
FALL = {
    "format": "iplw.scene/1",
    "name": "fall",
    "gravity": [0, -9.81],
    "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 1], "velocity": [1.5, 0.5]}],
    "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}],
    "effects": [
        {"name": "linear_drag", "parameters": {"c": 0.8}},
        {"name": "place_push", "parameters": {"ax": 0.5, "x0": 0, "y0": 1, "wx": 0.5, "wy": 0.5}},
    ],
    "steps": 360,
}


def play_scene(page: Page, scene: dict[str, Any]) -> None:
    """Opens a scene as another view hands it over."""
    page.evaluate("([key, text]) => sessionStorage.setItem(key, text)", ["iplw-scene", json.dumps(scene)])
    page.evaluate("sessionStorage.setItem('iplw-scene-box', 'null'), location.hash = '#/play/scene'")
    expect(page.locator(".play-head strong").first).to_have_text(scene["name"])
    film(page)


def box(page: Page) -> list[float]:
    return [float(v) for v in (stage(page).get_attribute("viewBox") or "").split()]


def test_the_view_zooms_moves_and_fits(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = new_page(serve()).open("#/jobs")
    play_scene(page, FALL)
    fitted = box(page)
    # A disc over a floor has surroundings, and its whole trajectory is visible.
    assert fitted[2] > 0.8 and fitted[3] > 0.6
    ends = [tuple(map(float, p.split(","))) for p in trails(page)[0].split()]
    assert all(fitted[0] < x < fitted[0] + fitted[2] and fitted[1] < -y < fitted[1] + fitted[3] for x, y in ends)
    expect(page.locator(".scale-bar")).to_contain_text(" m")
    page.get_by_role("button", name="Zoom in").click()
    assert abs(box(page)[2] - fitted[2] / 1.25) < 1e-6
    page.get_by_role("button", name="Fit the view").click()
    assert box(page) == fitted
    page.mouse.move(*point(page, 0.2, 0.8))
    page.mouse.wheel(0, -200)
    page.wait_for_function("(w) => Number(document.querySelector('.stage svg.scene').getAttribute('viewBox').split(' ')[2]) < w", arg=fitted[2])
    before = box(page)
    page.mouse.down()
    page.mouse.move(*(v + 60 for v in point(page, 0.2, 0.8)))
    page.mouse.up()
    assert box(page)[0] < before[0] and abs(box(page)[2] - before[2]) < 1e-9
    stage(page).focus()
    page.keyboard.press("0")
    assert box(page) == fitted
    page.keyboard.press("Shift+ArrowRight")
    assert box(page)[0] > fitted[0]
    page.keyboard.press("-")
    assert box(page)[2] > fitted[2]


def test_effects_of_a_scene_are_switches(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open("#/jobs")
    play_scene(page, FALL)
    switches = page.get_by_role("group", name="Effects of the scene")
    expect(switches).to_contain_text("linear drag")
    expect(switches).to_contain_text("c = 0.8 1/s")
    expect(switches).to_contain_text("empirical force field")
    expect(switches).not_to_contain_text("place_push")
    assert page.locator("select option[value=place_push]").count() == 0
    before, seen = trails(page)[0], film(page)
    for name in ("linear drag", "empirical force field"):
        page.get_by_role("switch", name=name).uncheck()
    page.wait_for_function(f"() => {FILMS} >= {seen} + 2")
    free = server.request("POST", "/v1/simulate", {"scene": {**FALL, "effects": []}})["bodies"]["ball"]["x"][-1]
    page.wait_for_function("(x) => Math.abs(Number(document.querySelector('.stage .trail').getAttribute('points').split(' ').at(-1).split(',')[0]) - x) < 1e-3", arg=free)
    assert trails(page)[0] != before
    for name in ("linear drag", "empirical force field"):
        page.get_by_role("switch", name=name).check()
    page.wait_for_function("(p) => document.querySelector('.stage .trail').getAttribute('points') === p", arg=before)


def test_overlays_are_drawn_explained_and_remembered(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = new_page(serve()).open("#/jobs")
    play_scene(page, FALL)
    legend = page.locator(".legend summary")
    expect(legend).to_contain_text("simulated")
    expect(legend).not_to_contain_text("measured")
    expect(page.locator(".stage .arrow")).to_have_count(0)
    rings = [ring.get_attribute("r") for ring in page.locator(".stage .contact").all()]
    assert len(set(rings)) == 1
    for name in ("Velocity", "Force per mass", "Impact speed"):
        page.get_by_label(name).check()
    page.get_by_label("Time", exact=True).fill("0.2")
    expect(page.locator(".stage .arrow")).to_have_count(2)
    expect(legend).to_contain_text("m/s²")
    rings = [ring.get_attribute("r") for ring in page.locator(".stage .contact").all()]
    assert len(set(rings)) == len(rings) > 1
    page.reload()
    film(page)
    expect(page.get_by_label("Velocity")).to_be_checked()


def test_two_simulations_are_compared(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = new_page(serve()).open("#/jobs")
    play_scene(page, FALL)
    second = page.locator(".canvas.second")
    expect(second).to_be_hidden()
    choice = page.get_by_label("Compare with")
    choice.select_option("base")
    expect(second).to_be_visible()
    expect(second).to_contain_text("Without effects")
    distance = page.locator(".gap-simulated")
    expect(distance).to_contain_text("At most")
    other = page.locator(".stage .trail.other").get_attribute("points")
    assert other != page.locator(".stage .trail:not(.other)").get_attribute("points")
    assert page.locator(".second .trail").get_attribute("points") == other
    # Frozen physics equal the current ones until these change.
    choice.select_option("frozen")
    expect(distance).to_contain_text("The same motion.")
    page.get_by_label("restitution").fill("0.2")
    expect(distance).to_contain_text("At most")
    choice.select_option("none")
    expect(second).to_be_hidden()
    expect(distance).to_be_hidden()
