"""Calibrate: an estimation from its form to its result, across a reload; cancellation; comparison of two; an ask/tell estimation
with valid and invalid measurements."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, expect

#: Latents of the rig, unknown to the server.
TRUTH = {"density": 1.0, "friction": 0.7, "restitution": 0.35}
#: Long enough to be cancelled on any machine.
LONG = {"task": "bowling", "rounds": 200, "actions": 20, "samples": 2000, "seed": 1}
RIG = {"task": "basketball", "real": "ask_tell", "rounds": 2, "actions": 2, "samples": 8, "seed": 3}

#: Events of dropping a file, and of pasting a spreadsheet range.
DROP = """(at, text) => {
  const data = new DataTransfer();
  data.items.add(new File([text], "measured.csv"));
  at.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
}"""
PASTE = """(at, text) => {
  const data = new DataTransfer();
  data.setData("text", text);
  at.dispatchEvent(new ClipboardEvent("paste", { clipboardData: data, bubbles: true, cancelable: true }));
}"""


def short(seed: int) -> dict[str, Any]:
    return {"task": "basketball", "rounds": 2, "actions": 2, "samples": 8, "seed": seed}


def fill(page: Page, **fields: str) -> None:
    form = page.get_by_role("form", name="Start an estimation")
    for label, value in fields.items():
        form.get_by_label(label.replace("_", " ")).first.fill(value)


def test_an_estimation_is_displayed_until_its_end_across_a_reload(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open("#/calibrate")
    fill(page, Rounds="2", Actions_per_round="2")
    page.locator("summary", has_text="More").click()
    fill(page, Samples="3", Seed="1")
    page.get_by_label("Restitution").fill("0.4")
    page.get_by_role("button", name="Start").click()
    # Too few samples: the server's message is displayed at the field.
    samples = page.get_by_label("Samples per iteration")
    expect(samples).to_have_attribute("aria-invalid", "true")
    expect(page.locator(".field", has=samples)).to_contain_text("from 4 to 100000")
    samples.fill("8")
    page.get_by_role("button", name="Start").press("Enter")
    page.wait_for_url(re.compile(r"#/calibrate/job-\d+"))
    job = page.url.rsplit("/", 1)[1]
    page.reload()
    head = page.locator(".calibrate-head")
    expect(head.locator(".state")).to_have_text("succeeded")
    expect(head.locator(".count")).to_have_text("4")
    result = server.request("GET", f"/v1/jobs/{job}")["result"]
    for latent in result["latents"]:
        tile = page.locator(f"[data-latent={latent['name']}]")
        expect(tile.locator("strong")).to_contain_text(formatted(latent))
        expect(tile.locator(".tag")).to_have_text("identifiable" if latent["identifiable"] else "not identifiable")
        expect(tile.locator("circle")).to_have_count(2)
    assert [latent["identifiable"] for latent in result["latents"]] == [False, False, True]
    expect(page.locator("tr[data-round]")).to_have_count(2)
    expect(page.get_by_role("img", name=re.compile("proposal [23]: "))).to_have_count(2)
    # Real and simulated trajectories, the worst trial first; displaying another one spends no interactions.
    worst = page.locator(".worst button")
    expect(worst).to_have_count(4)
    apart = [float(re.search(r"([\d.]+) m apart", text)[1]) for text in worst.all_inner_texts()]  # type: ignore[index]
    assert apart == sorted(apart, reverse=True)
    expect(page.locator(".gap")).to_be_visible()
    worst.nth(1).click()
    expect(worst.nth(1)).to_have_attribute("aria-pressed", "true")
    assert server.request("GET", f"/v1/iplw/{job}/rounds")["interactions"] == 4


def test_an_example_leads_to_a_diagnosis_and_a_plan(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open("#/calibrate")
    page.get_by_role("button", name="Try with bowling, 2 rounds").click()
    page.wait_for_url(re.compile(r"#/calibrate/job-\d+"))
    job = page.url.rsplit("/", 1)[1]
    following = page.get_by_role("region", name="Next steps")
    # The real world has a drag that the simulation lacks.
    expect(following.locator(".fit-line.bad")).to_contain_text("The model does not fit")
    expect(following.locator("[aria-current=step]")).to_contain_text("Calibrate")
    following.get_by_role("button", name="curl", exact=True).click()
    expect(following.locator("pre")).to_contain_text("/v1/simulate")
    following.get_by_role("button", name="Plan in the calibrated world").click()
    page.wait_for_url(re.compile(rf"#/plan\?task=bowling%3A\d+&estimation={job}$"))
    scene = json.loads(page.evaluate("sessionStorage.getItem('iplw-scene')"))
    restitution = next(x["value"] for x in server.request("GET", f"/v1/jobs/{job}")["result"]["latents"] if x["name"] == "restitution")
    assert {body["restitution"] for body in scene["bodies"]} == {restitution} and scene["action"]
    page.go_back()
    following.get_by_role("button", name="Diagnose these trials").click()
    page.wait_for_url(re.compile(r"#/diagnose/job-\d+"))
    diagnosis = page.url.rsplit("/", 1)[1]
    assert server.request("GET", f"/v1/jobs/{diagnosis}")["config"]["job"] == job
    page.get_by_role("button", name="Cancel").click()
    # As from the result of a diagnosis: the form with the effect fitted as well.
    page.goto(f"{server.page}/#/calibrate?like={job}&fit=linear_drag.c")
    expect(page.get_by_label("Also fit")).to_have_value("linear_drag.c")
    page.get_by_role("button", name="Start").click()
    expect(following.locator(".fit-line.good")).to_contain_text("The fit explains the trials down to the noise")


def formatted(latent: dict[str, Any]) -> str:
    """A latent's value as the page formats it: with enough digits to distinguish the bounds of its interval."""
    low, high = latent["ci95"]
    digits = (2 if abs(latent["value"]) >= 1 else 3) if low is None else max(3, 1 - math.floor(math.log10(high - low)))
    return f"{latent['value']:.{digits}f}"


def test_an_estimation_is_cancelled_and_two_are_compared(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    one, two = (server.request("POST", "/v1/iplw", short(seed))["id"] for seed in (7, 8))
    server.wait_for_job(one), server.wait_for_job(two)
    page = new_page(server).open(f"#/calibrate/{one}")
    page.get_by_label("Compare with").select_option(two)
    tile = page.locator("[data-latent=restitution]")
    for job in (one, two):
        latents = server.request("GET", f"/v1/iplw/{job}/rounds")["rounds"][-1]["latents"]
        found = next(latent for latent in latents if latent["name"] == "restitution")
        expect(tile.locator("p", has_text=job)).to_contain_text(formatted(found))
    expect(tile.locator("circle.second")).to_have_count(2)
    assert page.url.endswith(f"?with={two}")
    page.reload()
    expect(tile.locator("circle.second")).to_have_count(2)
    page.get_by_label("Compare with").select_option("")
    expect(tile.locator("circle.second")).to_have_count(0)
    # A running job is opened from the list of jobs and cancelled; its config fills the form again.
    long = server.request("POST", "/v1/iplw", LONG)["id"]
    page.get_by_role("link", name="Jobs", exact=True).click()
    page.locator(f"tr[data-job={long}]").get_by_role("link", name="Estimation", exact=True).click()
    state = page.locator(".calibrate-head .state")
    expect(state).to_have_text("running")
    page.get_by_role("button", name="Cancel").press("Enter")
    expect(state).to_have_text("cancelled")
    page.get_by_role("link", name="Start a similar one").click()
    expect(page.get_by_label("Actions per round")).to_have_value("20")


def test_an_ask_tell_estimation_is_answered(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Path) -> None:
    server = serve()
    job = server.request("POST", "/v1/iplw", RIG)["id"]
    page = new_page(server).open(f"#/calibrate/{job}")
    cards = page.locator("[data-proposal]")
    expect(cards).to_have_count(2)
    expect(page.get_by_role("img", name=re.compile("Proposal 0, basketball:.*initial state"))).to_be_visible()
    chooser, told = page.locator("input[type=file]"), page.locator(".drop .why")
    file = tmp_path / "measured.csv"
    for text, why in {"trial,t,body,x,y\n0,0,moon,1,2\n": "moon", "trial,t,body,x,y\n9,0,ball,1,2\n": "0 to 1 are open", "time,place\n1,2\n": "trial"}.items():
        file.write_text(text)
        chooser.set_input_files(file)
        expect(told).to_contain_text(why)
        expect(chooser).to_have_attribute("aria-invalid", "true")
    # Manual entry: a cell without a number, then one that the server rejects, each with a message at the cell.
    hand = cards.nth(0)
    hand.locator("summary").click()
    cell = hand.get_by_label("t, row 1")
    cell.fill("soon")
    hand.get_by_role("button", name="Submit").click()
    expect(hand.get_by_role("alert")).to_contain_text("“soon” is not a number")
    cell.fill("3")
    hand.get_by_label("ball x, row 1").fill("1")
    hand.get_by_label("ball y, row 1").fill("1")
    hand.get_by_role("button", name="Submit").click()
    expect(hand.get_by_role("alert")).to_contain_text("from 0 to 0.1 s")
    first, second = server.request("GET", f"/v1/iplw/{job}/proposals")["proposals"]
    cell.focus()
    cell.evaluate(PASTE, block(server, first))
    hand.get_by_role("button", name="Submit").click()
    expect(hand.locator(".tag")).to_have_text("answered")
    expect(page.locator(".calibrate-head .count")).to_have_text("1")
    file.write_text(csv(server, [second]))
    chooser.set_input_files(file)
    # The next round begins.
    expect(page.locator("[data-proposal='2']")).to_be_visible()
    expect(page.locator("[data-latent=restitution] circle")).to_have_count(1)
    rest = csv(server, server.request("GET", f"/v1/iplw/{job}/proposals")["proposals"])
    page.locator(".drop").evaluate(DROP, rest)
    expect(page.locator(".calibrate-head .state")).to_have_text("succeeded")
    expect(page.locator(".calibrate-head .count")).to_have_text("4")
    expect(page.locator(".worst button")).to_have_count(4)


def measured(server: Any, proposal: Any) -> Any:
    """The rig's measurement of a proposal: a simulation with the true latents."""
    return server.request("POST", "/v1/simulate", {"scene": proposal["scene"], "latents": TRUTH})


def csv(server: Any, proposals: list[Any]) -> str:
    lines = ["trial,t,body,x,y"]
    for proposal in proposals:
        seen = measured(server, proposal)
        lines += [f"{proposal['number']},{t},{name},{track['x'][k]},{track['y'][k]}" for k, t in enumerate(seen["t"]) for name, track in seen["bodies"].items()]
    return "\n".join([*lines, ""])


def block(server: Any, proposal: Any) -> str:
    """The same as a spreadsheet range."""
    seen = measured(server, proposal)
    bodies = [seen["bodies"][body["name"]] for body in proposal["scene"]["bodies"]]
    rows = [[t, *(v for track in bodies for v in (track["x"][k], track["y"][k]))] for k, t in enumerate(seen["t"])]
    return "\n".join("\t".join(map(str, row)) for row in rows)
