"""Diagnose: tracks are dropped, read settings are adjusted, the missing effect is displayed; its world is played, planned in,
calibrated, diagnosed again, exported and shared."""

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, Route, expect
from test_jobs import LONG
from throws import SIMILAR, LOW, csv, launches

#: Counts clicks.
CLICKS = "addEventListener('pointerdown', () => (window.clicks = (window.clicks ?? 0) + 1), true)"
DROP = """async ([name, text]) => {
  const files = new DataTransfer();
  files.items.add(new File([text], name, { type: 'text/csv' }));
  const zone = document.querySelector('.drop');
  for (const type of ['dragenter', 'dragover', 'drop']) {
    zone.dispatchEvent(new DragEvent(type, { dataTransfer: files, bubbles: true, cancelable: true }));
  }
}"""
#: Status text for falling objects with drag.
FALLS = re.compile(r"falling with (8|9|10|11)\.\d+ m/s²")
#: Maximum number of clicks and drops until the effect is displayed.
MOST = 6


def drop(page: Page, name: str, text: str) -> None:
    page.locator(".drop").wait_for()
    page.evaluate(DROP, [name, text])


def run(page: Page) -> None:
    page.get_by_role("button", name="Run the diagnosis").click()


#: Report of servers without one.
REPORT = """<html><head><style>h1 { margin: 0; }</style></head><body><main class="report"><header><h1>The simulation lacks quadratic
drag.</h1></header><nav class="contents"><a href="#gain">Gain</a></nav><details id="gain"><summary>Gain</summary><p>All.</p></details>
</main></body></html>"""


def with_report(page: Page) -> Page:
    """The page with the server's reports, or a fixed one if the server has none."""

    def answer(route: Route) -> None:
        response = route.fetch()
        if response.status == 404:
            route.fulfill(content_type="text/html", body=REPORT)
        else:
            route.fulfill(response=response)

    page.route("**/v1/jobs/*/report", answer)
    return page


def has_verdict(page: Page, verdict: str) -> None:
    """Waits for the result."""
    expect(page.locator("[data-whole]")).to_have_attribute("data-verdict", verdict)


def diagnosed(server: Any, names: str = "trial,t,x,y") -> Any:
    """A diagnosis of throws with quadratic drag."""
    body = {"ball": {"radius": 0.02}, "trials": csv(launches(14, 70), names)}
    return server.wait_for_job(server.request("POST", "/v1/diagnoses", body)["id"])


def stored_scene(page: Page) -> Any:
    """The scene that was handed to another view."""
    return json.loads(page.evaluate("sessionStorage.getItem('iplw-scene')"))


def test_a_hidden_effect_is_named_in_six_clicks(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = with_report(new_page(server).open())
    page.evaluate(CLICKS)
    page.get_by_role("link", name="Diagnose", exact=True).click()
    drop(page, "throws.csv", csv(launches(14, 70)))
    expect(page.locator(".glance")).to_contain_text("14 trials, 980 samples")
    expect(page.locator(".reading-line")).to_have_text("Columns: t in s, x and y in m; +y is up; 14 trials by column “trial”.")
    run(page)
    has_verdict(page, "named")
    expect(page.locator(".fit-line.bad")).to_contain_text("The base simulation does not fit")
    expect(page.locator(".fit-line.good")).to_contain_text("The simulation with quadratic drag explains the trials down to the noise")
    expect(page.locator("[data-report] h1")).to_contain_text("quadratic drag")
    clicks = page.evaluate("window.clicks") + 1
    print(f"open page, drop CSV, name of the effect: {clicks} clicks, the drop among them")
    assert clicks <= MOST
    k = server.request("GET", "/v1/jobs/job-1")["result"]["effects"][0]["parameters"][0]
    assert abs(k["value"] - 0.2) < 1e-3 and k["ci95"][0] <= 0.2 <= k["ci95"][1], k


def test_the_sample_is_diagnosed_and_played(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = with_report(new_page(serve()).open("#/diagnose"))
    play_sample(page)
    scene = stored_scene(page)
    assert scene["effects"][0]["name"] == "quadratic_drag" and abs(scene["effects"][0]["parameters"]["k"] - 0.131) < 0.005


def play_sample(page: Page) -> None:
    """From the empty page to the sample's extended world in Play."""
    page.get_by_role("button", name="Try with a sample CSV").click()
    expect(page.locator(".note").first).to_contain_text("A generated sample")
    expect(page.locator(".glance")).to_contain_text("14 trials, 560 samples")
    run(page)
    has_verdict(page, "named")
    page.get_by_role("button", name="Play in the extended world").click()
    expect(page.locator(".badge.sim")).to_have_text("Simulation: no goal")


def test_the_effect_of_the_sample_is_switched_off_and_on_in_play(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = with_report(new_page(serve()).open("#/diagnose"))
    play_sample(page)
    trail = page.locator(".stage .trail:not(.real)").first

    def distance() -> float:
        return float((trail.get_attribute("points") or "0,0").split()[-1].split(",")[0])

    switch = page.get_by_role("switch", name="quadratic drag").or_(page.get_by_role("checkbox", name="quadratic drag")).first
    expect(switch).to_be_checked()
    slowed = distance()
    switch.uncheck()
    page.wait_for_function("(at) => Number(document.querySelector('.stage .trail:not(.real)').getAttribute('points').split(' ').at(-1).split(',')[0]) > at + 0.1", arg=slowed)
    switch.check()
    page.wait_for_function("(at) => Math.abs(Number(document.querySelector('.stage .trail:not(.real)').getAttribute('points').split(' ').at(-1).split(',')[0]) - at) < 0.02", arg=slowed)


def test_a_result_is_exported_shared_and_played(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    job = diagnosed(server)
    page = with_report(new_page(server).open(f"#/diagnose/{job['id']}"))
    has_verdict(page, "named")
    actions = page.get_by_role("region", name="Next steps")

    def saved(name: str) -> str:
        with page.expect_download() as file:
            actions.get_by_role("button", name=name, exact=True).click()
        return Path(file.value.path()).read_text()

    assert json.loads(saved("Download result (JSON)"))["verdict"] == "named"
    assert json.loads(saved("Scene (JSON)")) == job["result"]["extended_scene"]
    assert '<main class="report"' in saved("Download report (HTML)")
    actions.get_by_role("button", name="curl", exact=True).click()
    expect(actions.locator("pre")).to_contain_text("/v1/simulate")
    actions.get_by_role("button", name="Python", exact=True).click()
    expect(actions.locator("pre")).to_contain_text("import iplw")
    assert '"quadratic_drag"' in saved("Save")
    actions.get_by_role("button", name="Play in the extended world").click()
    expect(page.locator(".badge.sim")).to_have_text("Simulation: no goal")
    # The video shows a measured launch with the diagnosed effects: without them the ball flies further.
    played = stored_scene(page)
    far = [server.request("POST", "/v1/simulate", {"scene": s})["bodies"]["ball"]["x"][-1] for s in (played, played | {"effects": []})]
    assert far[1] > far[0] + 0.1
    left, _, width, _ = map(float, (page.locator(".stage > svg.scene").get_attribute("viewBox") or "").split())
    assert left < 0 and left + width > 1
    trail = page.locator(".stage .trail").first.get_attribute("points") or ""
    assert abs(float(trail.split()[-1].split(",")[0]) - far[0]) < 0.02


def test_a_result_leads_to_plan_calibrate_and_another_diagnosis(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    job = diagnosed(server)["id"]
    page = with_report(new_page(server).open(f"#/diagnose/{job}"))
    has_verdict(page, "named")
    page.get_by_role("button", name="Plan in the extended world").click()
    page.wait_for_url(re.compile("#/plan/scene$"))
    # Actions are launch velocities within the measured range.
    components = stored_scene(page)["action"]["components"]
    assert [c["set"] for c in components] == ["vx", "vy"] and 2 < components[0]["low"] < components[0]["high"] < 10
    page.goto(f"{server.page}/#/diagnose/{job}")
    page.get_by_role("button", name="Calibrate in the extended world").click()
    expect(page.locator(".calibrated-scene")).to_contain_text("with quadratic drag; actions set ball vx, ball vy")
    page.get_by_role("button", name="Start").click()
    expect(page.locator("[data-proposal]").first).to_be_visible()
    page.goto(f"{server.page}/#/diagnose/{job}")
    page.get_by_role("button", name="Diagnose again with the extended scene").click()
    page.wait_for_url(lambda url: "#/diagnose/" in url and not url.endswith(job))
    has_verdict(page, "none")
    expect(page.locator(".fit-line")).to_have_count(1)
    expect(page.locator(".fit-line.good")).to_be_visible()


def test_trials_bear_the_user_s_names(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    text = re.sub(r"^(\d+),", lambda m: f"throw {int(m[1]) + 1},", csv(launches(14, 70)), flags=re.MULTILINE)
    job = server.request("POST", "/v1/diagnoses", {"ball": {"radius": 0.02}, "trials": text})["id"]
    server.wait_for_job(job)
    page = with_report(new_page(server).open(f"#/diagnose/{job}"))
    page.get_by_text("Look at each trial").click()
    trial = page.get_by_label("Trial", exact=True)
    trial.select_option("6")
    expect(page.get_by_role("img", name="throw 7: measured")).to_be_visible()
    page.get_by_role("button", name="Next trial").click()
    expect(page.get_by_role("img", name="throw 8: measured")).to_be_visible()
    page.get_by_role("button", name="Previous trial").click()
    expect(page.get_by_role("img", name="throw 7: residual in x")).to_be_visible()
    page.get_by_role("button", name="Play this trial").click()
    expect(page.locator(".badge.sim")).to_be_visible()
    assert stored_scene(page)["name"].endswith("throw 7")


def test_an_ambiguous_result_offers_the_next_experiment(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    body = {"ball": {"radius": 0.02}, "trials": csv(launches(4, 30, k=0.1, speeds=SIMILAR))}
    job = server.wait_for_job(server.request("POST", "/v1/diagnoses", body)["id"])
    assert job["result"]["verdict"] == "ambiguous" and job["result"]["next_scene"], job["result"]["reason"]
    page = with_report(new_page(server).open(f"#/diagnose/{job['id']}"))
    has_verdict(page, "ambiguous")
    page.get_by_role("button", name="Play the next experiment").click()
    expect(page.locator(".badge.sim")).to_be_visible()
    assert stored_scene(page) == job["result"]["next_scene"]


def test_pixel_scale_and_direction_are_set_manually(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = with_report(new_page(serve()).open("#/diagnose"))
    drop(page, "film.csv", csv(launches(12, 40), "track_id,frame no,pos_x,pos_y", scale=0.002, down=True).replace("e-05", ""))
    run_button = page.get_by_role("button", name="Run the diagnosis")
    expect(run_button).to_be_disabled()
    expect(page.get_by_text("enter frames per second")).to_be_visible()
    page.get_by_label("Time", exact=True).select_option(label="frame no")
    page.get_by_label("Frames per second").fill("1")
    page.get_by_label("Lengths in").select_option("px")
    expect(page.get_by_text("enter metres per pixel")).to_be_visible()
    # A ruler of one grid spacing; until the scale is set, pixels are drawn as metres.
    apart = float(page.locator(".over figcaption").inner_text().split("Grid lines are ")[1].split(" m")[0])
    page.get_by_label("object of length").fill(str(round(0.002 * apart, 4)))
    scale = page.evaluate("document.querySelector('.over svg.scene > g').getScreenCTM().a")
    box = page.locator(".over svg.scene").bounding_box()
    assert box
    x, y = box["x"] + 20, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + scale * apart / 2, y)
    page.mouse.move(x + scale * apart, y)
    page.mouse.up()
    size = page.get_by_label("Metres per pixel")
    assert abs(float(size.input_value()) - 0.002) < 0.00005
    size.fill("0.002")
    page.get_by_label("downwards").check()
    expect(page.locator(".glance")).to_contain_text("12 trials, 480 samples")
    expect(page.locator(".glance")).to_contain_text(FALLS)
    expect(page.locator(".reading-line")).to_contain_text("px of 0.002 m; −y is up; 12 trials")
    run(page)
    has_verdict(page, "named")
    expect(page.locator(".fit-line.good")).to_contain_text("quadratic drag")


def test_an_invalid_file_is_reported(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = new_page(serve()).open("#/diagnose")
    error = page.locator(".error")
    page.locator(".drop input").set_input_files({"name": "film.mp4", "mimeType": "video/mp4", "buffer": b"\x00\xff\xfe\x80"})
    expect(error).to_contain_text("film.mp4: It is not a UTF-8 text file")
    drop(page, "words.csv", "name,size\nred,1\n")
    run(page)
    expect(error).to_contain_text("a line that names the columns")
    # Lengths in mm without a unit: the server's message refers to the field.
    drop(page, "mm.csv", csv(launches(4, 60), scale=0.001))
    run(page)
    expect(error).to_contain_text("length_unit")
    page.get_by_label("Lengths in").select_option("mm")
    expect(page.locator(".glance")).to_contain_text(FALLS)
    page.get_by_label("Radius").fill("-1")
    run(page)
    expect(page.get_by_label("Radius")).to_have_attribute("aria-invalid", "true")
    expect(page.locator(".field .refused-why:visible")).to_contain_text("radius")
    page.get_by_label("Radius").fill("0.02")
    page.get_by_label("Mass").fill("heavy")
    expect(page.get_by_text("heavy is not a number")).to_be_visible()


def test_an_estimation_s_trials_are_diagnosed(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    asked = {"task": "basketball", "rounds": 1, "actions": 4, "samples": 12, "seed": 1}
    job = server.request("POST", "/v1/iplw", asked)["id"]
    server.wait_for_job(job)
    page = new_page(server).open("#/diagnose")
    page.get_by_label("an estimation's trials").check()
    page.get_by_label("Estimation", exact=True).select_option(job)
    run(page)
    expect(page.locator("[data-job]")).to_be_visible()
    own = page.locator("[data-job]").get_attribute("data-job")
    config = server.request("GET", f"/v1/jobs/{own}")["config"]
    assert (config["job"], config["trials"]) == (job, 4)


def test_tracks_of_a_diagnosis_are_displayed_after_a_reload(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Path) -> None:
    """While it is queued, after a reload and in another tab; then the verdict is displayed."""
    limits = tmp_path / "limits.json"
    limits.write_text(json.dumps({"jobs_running": 1}))
    server = serve("--limits", str(limits))
    before = server.request("POST", "/v1/iplw", LONG)["id"]
    page = with_report(new_page(server).open("#/diagnose"))
    drop(page, "film.csv", csv(launches(14, 70), scale=0.01))
    page.get_by_text("Change columns, units and directions").click()
    page.get_by_label("Lengths in").select_option("cm")
    expect(page.locator(".glance")).to_contain_text("3.81 m wide")
    told = page.locator(".glance").inner_text()
    run(page)
    title = page.locator("[data-job] h2")
    expect(title).to_have_text("The diagnosis is queued")
    job = page.locator("[data-job]").get_attribute("data-job")
    other = with_report(new_page(server).open(f"#/diagnose/{job}"))
    page.reload()
    for seen in (page, other):
        expect(seen.get_by_role("img", name="14 tracks over the scene")).to_be_visible()
        # As parsed: in metres, though the file is in centimetres.
        expect(seen.locator(".glance")).to_have_text(told)
        expect(seen.locator("[data-job] h2")).to_have_text("The diagnosis is queued")
    server.request("DELETE", f"/v1/jobs/{before}")
    for seen in (page, other):
        has_verdict(seen, "named")
        expect(seen.locator(".submitted")).to_have_count(0)


#: Records animation frames more than 100 ms apart, and scripts of that duration.
FRAMES = """() => {
  window.slow = { frames: [], scripts: [], all: 0 };
  let before = performance.now();
  const next = (now) => {
    if (now - before > 100) window.slow.frames.push(Math.round(now - before));
    window.slow.all += 1;
    before = now;
    requestAnimationFrame(next);
  };
  requestAnimationFrame(next);
  new PerformanceObserver((list) => list.getEntries().forEach((e) => e.duration > 100 && window.slow.scripts.push(Math.round(e.duration)))).observe({ type: 'longtask' });
}"""


#: Slowdown of the machine by other processes: 1 if idle.
SLOWDOWN = """async () => {
  const took = [];
  for (let i = 0; i < 60; i++) {
    const begun = performance.now();
    for (let k = 0, sum = 0; k < 2e6; k++) sum += Math.sqrt(k);
    took.push(performance.now() - begun);
    await new Promise((done) => setTimeout(done, 5));
  }
  return took.reduce((a, b) => a + b) / took.length / Math.max(0.1, Math.min(...took));
}"""


def test_the_page_is_responsive_with_134_bouncing_launches(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    """With WHOLE=1 until the result has been scrolled through, which takes a minute of CPU time; otherwise cancelled."""
    page = with_report(new_page(serve()).open("#/diagnose"))
    page.locator(".drop").wait_for()
    crowd = page.evaluate(SLOWDOWN)
    page.evaluate(FRAMES)
    drop(page, "bounces.csv", csv(launches(134, 80, bounce=0.85, speeds=LOW)))
    expect(page.locator(".glance")).to_contain_text("134 trials, 10720 samples")
    expect(page.locator(".note", has_text="A floor was set at y = ")).to_be_visible()
    expect(page.locator(".swatch.ground")).to_contain_text("floor, y = ")
    run(page)
    expect(page.locator(".stages li").first).to_be_visible()
    if os.environ.get("WHOLE"):
        page.locator("[data-whole]").wait_for(timeout=3_600_000)
        for _ in range(40):
            page.mouse.wheel(0, 400)
            page.wait_for_timeout(50)
        print(page.locator(".fit-lines").inner_text())
    else:
        page.locator(".stages li").nth(1).wait_for()
        page.get_by_role("button", name="Cancel").click()
        expect(page.get_by_role("heading", name="The diagnosis was cancelled")).to_be_visible()
        page.get_by_role("link", name="Back to the tracks").click()
        expect(page.locator(".glance")).to_contain_text("134 trials")
    slow = page.evaluate("window.slow")
    print(f"134 launches: of {slow['all']} pictures over 100 ms: {slow['frames']}; scripts: {slow['scripts']}; crowd {crowd:.1f}")
    assert len([ms for ms in slow["frames"] if ms > 100 * crowd]) <= 3
