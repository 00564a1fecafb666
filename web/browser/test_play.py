"""Play: a task is solved by mouse; displaying it spends no interactions."""

import json
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
    """Screen coordinates of a world position."""
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
    page.mouse.move(*point(page, x + 3, y))
    page.mouse.down()
    page.mouse.move(*point(page, x + 1, y))
    page.mouse.move(*point(page, x, y))
    page.mouse.up()
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
    page.keyboard.press("Shift+ArrowLeft")
    assert abs(float(x.input_value()) - before - 3 * 0.02 + 0.002) < 0.002
    run = page.get_by_role("button", name="Run in the real world")
    expect(run).to_be_enabled()
    run.focus()
    page.keyboard.press("Enter")
    expect(page.locator(".tally .count")).to_have_text("1")
    page.get_by_label("Effect", exact=True).select_option("wind")
    page.get_by_role("button", name="Add").press("Enter")
    expect(page.locator("fieldset.effect")).to_contain_text("a = (ax, ay)")


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
