"""Calibrate: an estimation from its form to what was found, across a reload; cancelled; two over each other; and a rig that
proposes, takes what was measured, and refuses what is none."""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, expect

#: What the rig's world really is, and the simulation does not know.
TRUTH = {"density": 1.0, "friction": 0.7, "restitution": 0.35}
#: Long enough to be cancelled whatever the machine.
LONG = {"task": "bowling", "rounds": 200, "actions": 20, "samples": 2000, "seed": 1}
RIG = {"task": "basketball", "real": "ask_tell", "rounds": 2, "actions": 2, "samples": 8, "seed": 3}

#: What a hand does that drops a file, or pastes a block of a spreadsheet.
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


def test_an_estimation_is_followed_to_its_end_across_a_reload(serve: Callable[..., Any], see: Callable[..., Any]) -> None:
    server = serve()
    page = see(server).open("#/calibrate")
    fill(page, Rounds="2", Actions_per_round="2")
    page.locator("summary", has_text="More").click()
    fill(page, Samples="3", Seed="1")
    page.get_by_label("Restitution").fill("0.4")
    page.get_by_role("button", name="Start").click()
    # Too few samples: told where they were typed, in the server's words.
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
    result = server.ask("GET", f"/v1/jobs/{job}")["result"]
    for latent in result["latents"]:
        tile = page.locator(f"[data-latent={latent['name']}]")
        expect(tile.locator("strong")).to_contain_text(shown(latent))
        expect(tile.locator(".tag")).to_have_text("identifiable" if latent["identifiable"] else "not identifiable")
        expect(tile.locator("circle")).to_have_count(2)
    assert [latent["identifiable"] for latent in result["latents"]] == [False, False, True]
    expect(page.locator("tr[data-round]")).to_have_count(2)
    expect(page.get_by_role("img", name=re.compile("proposal [23]: "))).to_have_count(2)
    # Real over simulated, the worst first; another one is looked at without spending anything.
    worst = page.locator(".worst button")
    expect(worst).to_have_count(4)
    apart = [float(re.search(r"([\d.]+) m apart", text)[1]) for text in worst.all_inner_texts()]  # type: ignore[index]
    assert apart == sorted(apart, reverse=True)
    expect(page.locator(".gap")).to_be_visible()
    worst.nth(1).click()
    expect(worst.nth(1)).to_have_attribute("aria-pressed", "true")
    assert server.ask("GET", f"/v1/iplw/{job}/rounds")["interactions"] == 4


def shown(latent: dict[str, Any]) -> str:
    """A latent's value as the page writes it: with an interval, so that its ends are told apart."""
    low, high = latent["ci95"]
    digits = (2 if abs(latent["value"]) >= 1 else 3) if low is None else max(3, 1 - math.floor(math.log10(high - low)))
    return f"{latent['value']:.{digits}f}"


def test_one_is_cancelled_and_two_are_compared(serve: Callable[..., Any], see: Callable[..., Any]) -> None:
    server = serve()
    one, two = (server.ask("POST", "/v1/iplw", short(seed))["id"] for seed in (7, 8))
    server.ended(one), server.ended(two)
    page = see(server).open(f"#/calibrate/{one}")
    page.get_by_label("Compare with").select_option(two)
    tile = page.locator("[data-latent=restitution]")
    for job in (one, two):
        latents = server.ask("GET", f"/v1/iplw/{job}/rounds")["rounds"][-1]["latents"]
        found = next(latent for latent in latents if latent["name"] == "restitution")
        expect(tile.locator("p", has_text=job)).to_contain_text(shown(found))
    expect(tile.locator("circle.second")).to_have_count(2)
    assert page.url.endswith(f"?with={two}")
    page.reload()
    expect(tile.locator("circle.second")).to_have_count(2)
    page.get_by_label("Compare with").select_option("")
    expect(tile.locator("circle.second")).to_have_count(0)
    # From the list of jobs to one that runs, which is cancelled; what it was asked for fills the form again.
    long = server.ask("POST", "/v1/iplw", LONG)["id"]
    page.get_by_role("link", name="Jobs", exact=True).click()
    page.locator(f"tr[data-job={long}]").get_by_role("link", name="Estimation").click()
    state = page.locator(".calibrate-head .state")
    expect(state).to_have_text("running")
    page.get_by_role("button", name="Cancel").press("Enter")
    expect(state).to_have_text("cancelled")
    page.get_by_role("link", name="Start a similar one").click()
    expect(page.get_by_label("Actions per round")).to_have_value("20")


def test_a_rig_is_asked_and_told(serve: Callable[..., Any], see: Callable[..., Any], tmp_path: Path) -> None:
    server = serve()
    job = server.ask("POST", "/v1/iplw", RIG)["id"]
    page = see(server).open(f"#/calibrate/{job}")
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
    # By hand: a cell that holds no number, then one that the server refuses, each told at the cell.
    hand = cards.nth(0)
    hand.locator("summary").click()
    cell = hand.get_by_label("t, row 1")
    cell.fill("soon")
    hand.get_by_role("button", name="Submit").click()
    expect(hand.get_by_role("alert")).to_contain_text("“soon” is no number")
    cell.fill("3")
    hand.get_by_label("ball x, row 1").fill("1")
    hand.get_by_label("ball y, row 1").fill("1")
    hand.get_by_role("button", name="Submit").click()
    expect(hand.get_by_role("alert")).to_contain_text("from 0 to 0.1 s")
    first, second = server.ask("GET", f"/v1/iplw/{job}/proposals")["proposals"]
    cell.focus()
    cell.evaluate(PASTE, block(server, first))
    hand.get_by_role("button", name="Submit").click()
    expect(hand.locator(".tag")).to_have_text("answered")
    expect(page.locator(".calibrate-head .count")).to_have_text("1")
    file.write_text(csv(server, [second]))
    chooser.set_input_files(file)
    # The next round comes.
    expect(page.locator("[data-proposal='2']")).to_be_visible()
    expect(page.locator("[data-latent=restitution] circle")).to_have_count(1)
    rest = csv(server, server.ask("GET", f"/v1/iplw/{job}/proposals")["proposals"])
    page.locator(".drop").evaluate(DROP, rest)
    expect(page.locator(".calibrate-head .state")).to_have_text("succeeded")
    expect(page.locator(".calibrate-head .count")).to_have_text("4")
    expect(page.locator(".worst button")).to_have_count(4)


def measured(server: Any, proposal: Any) -> Any:
    """What the rig sees of a proposal: a simulation with the true latents."""
    return server.ask("POST", "/v1/simulate", {"scene": proposal["scene"], "latents": TRUTH})


def csv(server: Any, proposals: list[Any]) -> str:
    lines = ["trial,t,body,x,y"]
    for proposal in proposals:
        seen = measured(server, proposal)
        lines += [f"{proposal['number']},{t},{name},{track['x'][k]},{track['y'][k]}" for k, t in enumerate(seen["t"]) for name, track in seen["bodies"].items()]
    return "\n".join([*lines, ""])


def block(server: Any, proposal: Any) -> str:
    """The same as a block of a spreadsheet."""
    seen = measured(server, proposal)
    bodies = [seen["bodies"][body["name"]] for body in proposal["scene"]["bodies"]]
    rows = [[t, *(v for track in bodies for v in (track["x"][k], track["y"][k]))] for k, t in enumerate(seen["t"])]
    return "\n".join("\t".join(map(str, row)) for row in rows)
