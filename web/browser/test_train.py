"""Train: a policy learns while one looks, is set beside chance, and shows what it would try; refusals, and a server that ends."""

import re
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect
from test_jobs import SHORT

#: Little work, which still learns: one task, as many updates as a curve needs points.
SMALL = {"task": "basketball:000", "batches": 60, "seed": 1}
ATTEMPTS = 10


def section(page: Page, name: str) -> Locator:
    return page.get_by_role("region", name=name, exact=True)


def points(page: Page, name: str) -> int:
    """Points of a curve, 0 where there is none."""
    return int(page.evaluate(f"Number(document.querySelector('[data-series=\"{name}\"]')?.dataset.points ?? 0)"))


def evaluated(page: Page, server: Any, number: int) -> Any:
    """The result of an evaluation that the page asked for."""
    job = f"job-{number}"
    page.wait_for_function("(id) => fetch(`/v1/jobs/${id}`).then((r) => r.ok)", arg=job)
    return server.ended(job)["result"]


def compared(page: Page, server: Any) -> None:
    """A training with its curves, compared with chance, and its map. Trained and evaluated once for all pictures."""
    if not server.ask("GET", "/v1/policies")["policies"]:
        training = {"task": "basketball:000", "batches": 300, "seed": 1, "validations": 6}
        done = server.ended(server.ask("POST", "/v1/policies", training)["id"])
        for policy in ("random", done["result"]["policy"]):
            server.ended(server.ask("POST", f"/v1/policies/{policy}/evaluate", {"world": "basketball-real"})["id"])
        page.reload()
    page.locator(".map-place").scroll_into_view_if_needed()
    page.locator(".tries li").first.wait_for()


def filled(page: Page, batches: int, validations: int) -> Locator:
    """The form with a small training in it."""
    form = section(page, "Train")
    form.get_by_label("Tasks").select_option(str(SMALL["task"]))
    form.get_by_label("Updates", exact=True).fill(str(batches))
    form.get_by_label("Validations").fill(str(validations))
    form.get_by_label("Seed").fill(str(SMALL["seed"]))
    return form


def test_a_policy_is_trained_set_beside_chance_and_shows_what_it_would_try(serve: Callable[..., Any], see: Callable[..., Any]) -> None:
    server = serve()
    page = see(server).open("#/train?family=basketball")
    form = filled(page, 300, 2)
    # A wrong budget is told at its field, in the server's words; and what is wrong with another, there.
    form.get_by_label("Updates", exact=True).fill("200000")
    form.get_by_role("button", name="Train").click()
    refused = form.get_by_label("Updates", exact=True)
    expect(refused).to_have_attribute("aria-invalid", "true")
    expect(refused).to_be_focused()
    expect(form.locator(".why").filter(has_text="100000")).to_be_visible()
    expect(page.locator(".errors")).to_be_empty()
    refused.fill("300")
    expect(refused).not_to_have_attribute("aria-invalid", "true")
    form.get_by_label("friction").fill("-1")
    form.get_by_label("friction").press("Enter")
    expect(form.get_by_label("friction")).to_have_attribute("aria-invalid", "true")
    form.get_by_label("friction").fill("0.7")
    form.get_by_label("friction").press("Enter")
    expect(form.locator(".state")).to_be_visible()
    # The loss grows point by point while it learns.
    page.wait_for_function("() => document.querySelector('[data-series=loss]')?.dataset.points > 1")
    server.ended("job-1")
    expect(form.locator(".state")).to_have_text("succeeded")
    assert points(page, "loss") == 150 and points(page, "validation AUCCESS") == 3
    expect(form.locator("[data-job]")).to_contain_text("policy-1: learned from")
    assert server.ask("GET", "/v1/jobs/job-1")["config"]["latents"] == {"friction": 0.7}
    # Beside chance, in the real world: both curves, their AUCCESS, and the jump start.
    compare = section(page, "Compare")
    expect(compare.get_by_label("Show policy-1")).to_be_checked()
    expect(compare.get_by_label("Show random")).to_be_checked()
    compare.get_by_label("World", exact=True).select_option("basketball-real")
    compare.get_by_label("Attempts per task").fill(str(ATTEMPTS))
    compare.get_by_role("button", name="Evaluate selected").click()
    for number, name in enumerate(("random", "policy-1"), start=2):
        auccess = evaluated(page, server, number)["auccess"]
        curve = compare.locator(f"[data-curve={name}]")
        expect(curve).to_contain_text(f"{auccess:.2f}")
        expect(compare.locator(f"tr[data-policy={name}]")).to_contain_text(f"{auccess:.2f} (")
        assert points(page, name) == ATTEMPTS
    spent = server.ask("GET", "/v1/worlds/basketball-real")["interactions"]
    expect(compare.get_by_text("Real interactions spent in basketball-real")).to_contain_text(str(spent))
    expect(compare.locator(".starts")).to_contain_text("policy-1")
    compare.get_by_label("Show random").uncheck()
    expect(compare.locator("[data-curve=random]")).to_have_count(0)
    # What it would try first, where it would, and one of them played.
    tries = section(page, "First tries")
    expect(tries.get_by_label("Policy", exact=True)).to_have_value("policy-1")
    tries.scroll_into_view_if_needed()
    expect(tries.locator(".tries li")).to_have_count(10)
    first = server.ask("POST", "/v1/policies/policy-1/act", {"task": "basketball:000", "count": 1})["actions"][0]
    expect(tries.locator(".chosen")).to_contain_text("try 1 (")
    tries.locator(".map svg").first.focus()
    page.keyboard.press("Enter")
    expect(page.locator(".badge.sim")).to_be_visible()
    for label, share in zip(("ball x", "ball y", "plank x", "plank y"), first["action"], strict=True):
        assert abs(float(page.get_by_label(label).input_value()) - share) < 2e-3
    # Nothing of this was an attempt.
    assert server.ask("GET", "/v1/worlds/basketball-real")["interactions"] == spent


def test_a_policy_learns_on_in_a_world_and_is_compared_with_what_it_was(serve: Callable[..., Any], see: Callable[..., Any]) -> None:
    server = serve()
    server.ended(server.ask("POST", "/v1/policies", SMALL)["id"])
    page = see(server).open("#/train/policy-1")
    form = section(page, "Train")
    form.get_by_label("Kind of training").select_option("learn")
    expect(form.get_by_label("friction")).to_be_hidden()
    form.get_by_label("World", exact=True).select_option("basketball-real")
    form.get_by_label("Attempts to learn from").fill("200")
    form.get_by_label("Updates", exact=True).fill("10")
    form.get_by_role("button", name="Train").click()
    expect(form.locator(".state")).to_be_visible()
    server.ended("job-2")
    expect(form.locator("[data-job] [role=status]")).to_contain_text("200 real attempts")
    policy = server.ask("GET", "/v1/policies")["policies"][-1]["id"]
    compare = section(page, "Compare")
    expect(compare.get_by_label(f"Show {policy}")).to_be_checked()
    compare.get_by_label("Show policy-1").check()
    compare.get_by_label("Attempts per task").fill(str(ATTEMPTS))
    compare.get_by_role("button", name="Evaluate selected").click()
    for number in (3, 4, 5):
        evaluated(page, server, number)
    expect(compare.locator(f"[data-curve={policy}]")).to_be_visible()
    expect(compare.locator("[data-curve=policy-1]")).to_be_visible()
    expect(compare.get_by_text("Further training in a world", exact=True)).to_be_visible()
    page.wait_for_function(f"() => [...document.querySelectorAll('[data-series={policy}]')].some((g) => g.dataset.points === '2')")
    # Jobs lead here.
    page.get_by_role("link", name="Jobs").click()
    page.get_by_role("link", name="Evaluation").first.click()
    expect(page).to_have_url(re.compile("#/train/job-"))
    expect(section(page, "Compare").get_by_label("Attempts per task")).to_have_value(str(ATTEMPTS))


def test_a_training_on_an_estimate_goes_on_when_the_server_comes_back(serve: Callable[..., Any], see: Callable[..., Any]) -> None:
    server = serve()
    estimation = server.ended(server.ask("POST", "/v1/iplw", {**SHORT, "task": "basketball"})["id"])
    page = see(server).open("#/train?family=basketball")
    form = filled(page, 100_000, 0)
    form.get_by_label("Latents", exact=True).select_option(estimation["id"])
    for latent in estimation["result"]["latents"]:
        expect(form.get_by_label(latent["name"])).to_have_value(f"{latent['value']:.6g}")
    form.get_by_role("button", name="Train").click()
    page.wait_for_function("() => document.querySelector('[data-series=loss]')?.dataset.points > 0")
    asked = server.ask("GET", "/v1/jobs/job-2")["config"]["latents"]
    assert asked == {latent["name"]: pytest.approx(latent["value"], rel=1e-5) for latent in estimation["result"]["latents"]}
    server.kill()
    expect(page.locator(".banner")).to_be_visible()
    server.back()
    expect(page.locator(".banner")).to_be_hidden()
    page.wait_for_function("() => document.querySelector('[data-series=loss]')?.dataset.points > 0")
    expect(form.locator(".state")).to_have_text("running")
    form.get_by_role("button", name="Cancel").click()
    expect(form.locator(".state")).to_have_text("cancelled")
