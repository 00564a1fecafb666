"""Live worlds: display while a program acts, hidden values, pagination; logs of jobs; memory of the page."""

import re
import subprocess
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any

from conftest import BINARY
from playwright.sync_api import Page, expect
from test_jobs import SHORT, copy_job

#: An estimation that is still running when displayed.
LONG = {"task": "bowling", "rounds": 200, "actions": 50, "samples": 4000, "seed": 1}


def act(server: Any, world: str, actions: list[Any], task: str | None = "bowling:000") -> list[Any]:
    """A reset and a step for each action, as by a program."""
    done = []
    for action in actions:
        server.request("POST", f"/v1/worlds/{world}/reset", {"task": task} if task else {})
        done.append(server.request("POST", f"/v1/worlds/{world}/step", {"action": action}))
    return done


def expect_connected(page: Page) -> None:
    expect(page.get_by_text("Watching.")).to_be_visible()


def test_a_program_is_displayed_step_by_step(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    solves = server.request("GET", "/v1/tasks/bowling/0")["certificate"]["action"]
    world = server.request("POST", "/v1/worlds", {"task": "bowling", "kind": "real", "budget": 9})["id"]
    page = new_page(server).open("#/live")
    page.get_by_role("link", name=world).click()
    expect_connected(page)
    happened = page.locator(".happened li")
    expect(happened).to_have_count(0)
    server.request("POST", f"/v1/worlds/{world}/reset", {"task": "bowling:000"})
    expect(happened.first).to_have_text("Reset to bowling:000")
    step = server.request("POST", f"/v1/worlds/{world}/step", {"action": solves})
    assert step["info"]["solved"]
    expect(happened.first).to_contain_text("solved, interactions 1")
    expect(page.locator(".stage .badge")).to_have_text("solved")
    expect(page.locator(".facts .count")).to_have_text("1 of 9")
    assert len(page.locator(".stage .trail").all()) == 3
    # The world's latents are hidden.
    expect(page.locator(".facts")).to_contain_text("Latentshidden")
    # The program continues with another task, and so another scene; earlier videos can be replayed.
    act(server, world, [[0.5, 0.9, 0.2]], "bowling:001")
    expect(happened.first).to_contain_text(re.compile(r"Step at 0\.500, 0\.900, 0\.200: "))
    expect(page.get_by_role("img", name=f"Scene of bowling:001 in {world}")).to_be_visible()
    happened.filter(has_text="solved, interactions 1").get_by_role("button").press("Enter")
    expect(page.get_by_role("img", name=f"Scene of bowling:000 in {world}")).to_be_visible()
    expect(page.get_by_label("Show the newest film automatically")).not_to_be_checked()
    # A rollout outside the episode counts as attempts; displaying it does not.
    server.request("POST", f"/v1/worlds/{world}/rollout", {"actions": [solves, solves], "task": "bowling:000", "trajectories": True})
    expect(happened.first).to_contain_text("2 attempts on bowling:000: 2 placed, 2 solved")
    assert server.request("GET", f"/v1/worlds/{world}")["interactions"] == int(page.locator(".facts .count").inner_text().split()[0])
    server.request("DELETE", f"/v1/worlds/{world}")
    expect(page.get_by_text("The world was deleted")).to_be_visible()


def test_success_and_return_are_curves(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    solves = server.request("GET", "/v1/tasks/bowling/0")["certificate"]["action"]
    world = server.request("POST", "/v1/worlds", {"task": "bowling", "max_attempts": 3})["id"]
    page = new_page(server).open(f"#/live/{world}")
    expect_connected(page)
    curve = page.get_by_role("region", name="Success and return")
    expect(curve).to_contain_text("The curve begins with the next episode that ends")
    fails = [0.5, 0.9, 0.2]
    rewards = []
    # Solved at the first attempt, at the second, not at all, abandoned.
    for actions in ([solves], [fails, solves], [fails] * 3, [fails]):
        server.request("POST", f"/v1/worlds/{world}/reset", {"task": "bowling:000"})
        steps = [server.request("POST", f"/v1/worlds/{world}/step", {"action": action}) for action in actions]
        rewards.append(sum(step["reward"] for step in steps))
    server.request("POST", f"/v1/worlds/{world}/reset", {})
    expect(curve.locator("[data-series=return]")).to_have_attribute("data-points", "4")
    expect(curve).to_contain_text("50 % of the last 4 solved")
    heights = curve.locator("[data-series=return] circle").evaluate_all("all => all.map((c) => Number(c.getAttribute('cy')))")
    top, bottom = min(heights), max(heights)
    assert [round((bottom - y) / (bottom - top), 2) for y in heights] == [round(reward, 2) for reward in rewards]


def test_an_example_shows_how_a_world_gets_here(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open("#/live")
    expect(page.get_by_role("region", name="Python example")).to_contain_text('gymnasium.make("iplw/Bowling-v0"')
    expect(page.get_by_role("region", name="curl example")).to_contain_text(f"curl {server.page}/v1/worlds ")
    page.get_by_role("button", name="Start an example world").click()
    expect(page.locator(".live-curve [data-series=success]")).to_be_attached()
    expect(page).not_to_have_url(re.compile("example"))
    # A world in which nothing has happened explains itself; real interactions are not spent by an example.
    page.goto(f"{server.page}/#/live/bowling-real")
    help = page.get_by_role("region", name="Act in this world")
    expect(help).to_contain_text('client.world("bowling-real")')
    expect(help.get_by_role("button", name="Play an example")).to_have_count(0)
    act(server, "bowling-real", [0])
    expect(help).to_be_hidden()


def test_a_world_view_continues_after_a_restart(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open("#/live/bowling-sim")
    expect_connected(page)
    act(server, "bowling-sim", [0])
    expect(page.locator(".happened li")).to_have_count(2)
    server.kill()
    expect(page.locator(".banner")).to_be_visible()
    server.restart()
    expect(page.locator(".banner")).to_be_hidden()
    expect_connected(page)
    page.wait_for_function("() => !document.querySelector('.banner:not([hidden])')")
    # Events are received only after reconnection.
    for _ in range(100):
        act(server, "bowling-sim", [1])
        if page.locator(".happened li").count() > 2:
            break
    expect(page.locator(".happened li").first).to_contain_text("Step")


def test_a_world_of_another_owner_is_not_displayed(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Any) -> None:
    tokens = tmp_path / "tokens"
    made = {}
    for name in ("ann", "bob"):
        command = [BINARY, "token", "new", name, "--scope", "act", "--token-file", tokens]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        made[name] = next(word for word in said.split() if word.startswith("iplw_"))
    server = serve("--token-file", str(tokens))
    server.token = made["ann"]
    world = server.request("POST", "/v1/worlds", {"task": "bowling"})["id"]
    server.token = made["bob"]
    try:
        server.request("GET", f"/v1/worlds/{world}/events")
        raise AssertionError("bob sees what is ann's")
    except urllib.error.HTTPError as refused:
        assert refused.code == 404
    page = new_page(server).open("#/live")
    sign = page.get_by_role("dialog", name="Sign in")
    sign.get_by_label("Token").fill(made["bob"])
    sign.get_by_role("button", name="Sign in").click()
    expect(page.get_by_role("link", name="bowling-real")).to_be_visible()
    expect(page.get_by_role("link", name=world)).to_have_count(0)
    page.goto(f"{server.page}/#/live/{world}")
    expect(page.locator(".error")).to_contain_text(world)
    expect(page.locator(".stage")).to_have_count(0)
    page.get_by_role("button", name="Sign out").click()
    sign.get_by_label("Token").fill(made["ann"])
    sign.get_by_role("button", name="Sign in").click()
    expect_connected(page)
    expect(page.locator(".facts")).to_contain_text("Ownerann")


def test_a_real_world_of_a_custom_scene_hides_its_materials(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    ball = {"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": None, "friction": 0.4375, "density": 3.625}
    scene = {
        "format": "iplw.scene/1",
        "name": "secret",
        "bodies": [ball],
        "statics": [{"name": "floor", "shape": {"type": "segment", "from": [-2, 0], "to": [2, 0]}, "restitution": 0.8125}],
        "goal": {"type": "inside", "body": "ball", "region": [[-1, 0], [1, 0], [1, 1], [-1, 1]]},
        "action": {"components": [{"target": "ball", "set": "x", "low": -1, "high": 1}, {"target": "ball", "set": "y", "low": 0.5, "high": 2}]},
        "steps": 240,
    }
    scene["bodies"][0].pop("position")  # type: ignore[index]
    world = server.request("POST", "/v1/worlds", {"scene": scene, "kind": "real", "effects": [{"name": "wind", "parameters": {"ax": 1.5625, "ay": 0}}]})["id"]
    session = new_page(server)
    told = urllib.request.urlopen(f"{server.url}/v1/worlds/{world}/events", timeout=60)
    page = session.open(f"#/live/{world}")
    expect_connected(page)
    server.request("POST", f"/v1/worlds/{world}/reset", {})
    server.request("POST", f"/v1/worlds/{world}/step", {"action": [0.5, 0.5]})
    expect(page.locator(".happened li").first).to_contain_text("Step at")
    assert len(page.locator(".stage .trail").all()) == 1
    # All events of the world until its deletion.
    server.request("DELETE", f"/v1/worlds/{world}")
    expect(page.get_by_text("The world was deleted")).to_be_visible()
    stream = told.read().decode()
    assert "event: gone" in stream and '"floor"' in stream
    for hidden in ("0.4375", "3.625", "0.8125", "1.5625", "wind", "friction", "restitution", "density"):
        assert hidden not in stream and hidden not in page.content(), hidden


def test_a_thousand_worlds_are_paginated(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    made = server.request("POST", "/v1/batch/worlds", {"task": "bowling", "count": 1000})["worlds"]
    page = new_page(server).open("#/play")
    page.locator(".badge.sim").wait_for()
    page.evaluate(FIRST_ROW)
    page.get_by_role("link", name="Live worlds").click()
    took = page.evaluate("window.firstRow")
    print(f"1,000 worlds, click to first rows: {took:.0f} ms")
    rows = page.locator(".worlds tbody tr")
    expect(rows).to_have_count(25)
    # Recently used worlds move to the top.
    used = made[500]
    act(server, used, [0])
    expect(rows.first).to_have_attribute("data-world", used)
    expect(rows.first).to_contain_text("now")
    page.get_by_label("Order").select_option("id")
    expect(rows.first).to_have_attribute("data-world", "basketball-real")
    page.get_by_role("button", name="More").click()
    expect(rows.first).not_to_have_attribute("data-world", "basketball-real")
    page.get_by_role("button", name="Back").click()
    expect(rows.first).to_have_attribute("data-world", "basketball-real")


#: Resolves after a click with the time until rows are displayed, ms.
FIRST_ROW = """() => {
  window.firstRow = new Promise((done) => addEventListener('click', () => {
    const begun = performance.now();
    const look = () => document.querySelector('tbody tr') ? done(performance.now() - begun) : requestAnimationFrame(look);
    look();
  }, { once: true, capture: true }));
}"""


def test_the_log_of_a_job_is_displayed_line_by_line(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    job = server.request("POST", "/v1/iplw", LONG)["id"]
    page = new_page(server).open(f"#/jobs/{job}")
    log = page.get_by_role("log", name=f"Log of {job}")
    expect(log).to_contain_text("queued")
    expect(log).to_contain_text("started")
    expect(log).to_contain_text(re.compile(r"\d\d:\d\d:\d\d round 1 of 200: "))
    server.kill()
    expect(page.locator(".banner")).to_be_visible()
    server.restart()
    expect(log).to_contain_text("the server was started: the job is queued again")
    server.request("DELETE", f"/v1/jobs/{job}")
    expect(log.locator(".line").last).to_contain_text("cancelled")
    # The log is scrolled to its end.
    assert log.evaluate("e => e.scrollTop + e.clientHeight >= e.scrollHeight - 4")
    numbers = [int(line.get_attribute("data-line") or 0) for line in log.locator(".line").all()]
    assert numbers == list(range(1, len(numbers) + 1)), "each line once, in order"
    # A failed job displays the reason: the budget is spent.
    world = server.request("POST", "/v1/worlds", {"task": "bowling", "kind": "real", "budget": 0})["id"]
    spent = server.request("POST", "/v1/iplw", {**SHORT, "world": world})["id"]
    server.wait_for_job(spent)
    page.goto(f"{server.page}/#/jobs/{spent}")
    log = page.get_by_role("log", name=f"Log of {spent}")
    expect(log.locator(".is-warning")).to_contain_text("the budget of real interactions is exhausted")
    expect(log.locator(".is-error")).to_contain_text("failed")


def test_memory_is_limited_after_long_lists(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    server.wait_for_job(server.request("POST", "/v1/iplw", SHORT)["id"])
    server.kill()
    copy_job(server.folder / "iplw.sqlite", 10_000)
    server.restart()
    server.request("POST", "/v1/batch/worlds", {"task": "bowling", "count": 1000})
    page = new_page(server).open("#/live")
    page.wait_for_selector("tbody tr")
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    print(f"first picture on loopback: {paint:.0f} ms after the address was opened")
    for view, more, pages in (("#/live", "More", 40), ("#/jobs", "Older", 20)):
        page.goto(f"{server.page}/{view}")
        page.wait_for_selector("tbody tr")
        for _ in range(pages):
            first = page.locator("tbody tr th").first.inner_text()
            page.get_by_role("button", name=more).click()
            page.wait_for_function(f"() => document.querySelector('tbody tr th')?.innerText !== {first!r}")
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    session.send("HeapProfiler.collectGarbage")
    metrics = {m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}
    used = metrics["JSHeapUsedSize"] / 2**20
    print(f"memory of the tab with 10,000 jobs and all of 1,000 worlds looked through: {used:.1f} MiB of heap")
    assert used < 200
    assert metrics["Nodes"] < 20_000
