"""Train: training progress, comparison with the random policy, display of actions, rejected requests, restarts of the server."""

import re
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect
from test_jobs import SHORT

#: A short training that still learns: one task, and enough updates for a curve.
SMALL = {"task": "basketball:000", "batches": 60, "seed": 1}
ATTEMPTS = 10


def section(page: Page, name: str) -> Locator:
    return page.get_by_role("region", name=name, exact=True)


def points(page: Page, name: str) -> int:
    """Number of points of a curve, 0 if there is none."""
    return int(page.evaluate(f"Number(document.querySelector('[data-series=\"{name}\"]')?.dataset.points ?? 0)"))


def evaluation_result(page: Page, server: Any, number: int) -> Any:
    """The result of an evaluation requested by the page."""
    job = f"job-{number}"
    page.wait_for_function("(id) => fetch(`/v1/jobs/${id}`).then((r) => r.ok)", arg=job)
    return server.wait_for_job(job)["result"]


def prepare_comparison(page: Page, server: Any) -> None:
    """A training with its curves, compared with the random policy, and its map. Trained and evaluated once for all screenshots."""
    if not server.request("GET", "/v1/policies")["policies"]:
        training = {"task": "basketball:000", "batches": 300, "seed": 1, "validations": 6}
        done = server.wait_for_job(server.request("POST", "/v1/policies", training)["id"])
        for policy in ("random", done["result"]["policy"]):
            server.wait_for_job(server.request("POST", f"/v1/policies/{policy}/evaluate", {"world": "basketball-real"})["id"])
        page.reload()
    page.locator(".map-place").scroll_into_view_if_needed()
    page.locator(".tries li").first.wait_for()


def fill_form(page: Page, batches: int, validations: int) -> Locator:
    """The form, filled in for a small training."""
    form = section(page, "Train")
    form.get_by_label("Tasks").select_option(str(SMALL["task"]))
    form.get_by_label("Updates", exact=True).fill(str(batches))
    form.get_by_label("Validations").fill(str(validations))
    form.get_by_label("Seed").fill(str(SMALL["seed"]))
    return form


def test_a_policy_is_trained_compared_with_random_and_its_actions_are_displayed(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open("#/train?family=basketball")
    form = fill_form(page, 300, 2)
    # The server's message about an invalid value is displayed at its field, for each field.
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
    # The loss curve grows during the training.
    page.wait_for_function("() => document.querySelector('[data-series=loss]')?.dataset.points > 1")
    server.wait_for_job("job-1")
    expect(form.locator(".state")).to_have_text("succeeded")
    assert points(page, "loss") == 150 and points(page, "validation AUCCESS") == 3
    expect(form.locator("[data-job]")).to_contain_text("policy-1: trained on")
    assert server.request("GET", "/v1/jobs/job-1")["config"]["latents"] == {"friction": 0.7}
    # Comparison with the random policy in the real world: both curves, their AUCCESS, and the jump start.
    compare = section(page, "Compare")
    expect(compare.get_by_label("Show policy-1")).to_be_checked()
    expect(compare.get_by_label("Show random")).to_be_checked()
    compare.get_by_label("World", exact=True).select_option("basketball-real")
    compare.get_by_label("Attempts per task").fill(str(ATTEMPTS))
    compare.get_by_role("button", name="Evaluate selected").click()
    for number, name in enumerate(("random", "policy-1"), start=2):
        auccess = evaluation_result(page, server, number)["auccess"]
        curve = compare.locator(f"[data-curve={name}]")
        expect(curve).to_contain_text(f"{auccess:.2f}")
        expect(compare.locator(f"tr[data-policy={name}]")).to_contain_text(f"{auccess:.2f} (")
        assert points(page, name) == ATTEMPTS
    spent = server.request("GET", "/v1/worlds/basketball-real")["interactions"]
    expect(compare.get_by_text("Real interactions spent in basketball-real")).to_contain_text(str(spent))
    expect(compare.locator(".starts")).to_contain_text("policy-1")
    compare.get_by_label("Show random").uncheck()
    expect(compare.locator("[data-curve=random]")).to_have_count(0)
    # The policy's first actions, their positions, and one of them played.
    tries = section(page, "First attempts")
    expect(tries.get_by_label("Policy", exact=True)).to_have_value("policy-1")
    tries.scroll_into_view_if_needed()
    expect(tries.locator(".tries li")).to_have_count(10)
    first = server.request("POST", "/v1/policies/policy-1/act", {"task": "basketball:000", "count": 1})["actions"][0]
    expect(tries.locator(".chosen")).to_contain_text("attempt 1 (")
    tries.locator(".map svg").first.focus()
    page.keyboard.press("Enter")
    expect(page.locator(".badge.sim")).to_be_visible()
    for label, share in zip(("ball x", "ball y", "plank x", "plank y"), first["action"], strict=True):
        assert abs(float(page.get_by_label(label).input_value()) - share) < 2e-3
    # None of this counts as an attempt.
    assert server.request("GET", "/v1/worlds/basketball-real")["interactions"] == spent


def test_a_policy_is_trained_further_in_a_world_and_compared_with_its_predecessor(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    server.wait_for_job(server.request("POST", "/v1/policies", SMALL)["id"])
    page = new_page(server).open("#/train/policy-1")
    form = section(page, "Train")
    form.get_by_label("Kind of training").select_option("learn")
    expect(form.get_by_label("friction")).to_be_hidden()
    form.get_by_label("World", exact=True).select_option("basketball-real")
    form.get_by_label("Attempts to learn from").fill("200")
    form.get_by_label("Updates", exact=True).fill("10")
    form.get_by_role("button", name="Train").click()
    expect(form.locator(".state")).to_be_visible()
    server.wait_for_job("job-2")
    expect(form.locator("[data-job] [role=status]")).to_contain_text("200 real attempts")
    policy = server.request("GET", "/v1/policies")["policies"][-1]["id"]
    compare = section(page, "Compare")
    expect(compare.get_by_label(f"Show {policy}")).to_be_checked()
    compare.get_by_label("Show policy-1").check()
    compare.get_by_label("Attempts per task").fill(str(ATTEMPTS))
    compare.get_by_role("button", name="Evaluate selected").click()
    for number in (3, 4, 5):
        evaluation_result(page, server, number)
    expect(compare.locator(f"[data-curve={policy}]")).to_be_visible()
    expect(compare.locator("[data-curve=policy-1]")).to_be_visible()
    expect(compare.get_by_text("Further training in a world", exact=True)).to_be_visible()
    page.wait_for_function(f"() => [...document.querySelectorAll('[data-series={policy}]')].some((g) => g.dataset.points === '2')")
    # Jobs link to this view.
    page.get_by_role("link", name="Jobs").click()
    page.get_by_role("link", name="Evaluation").first.click()
    page.get_by_role("link", name="Open in its view").click()
    expect(page).to_have_url(re.compile("#/train/job-"))
    expect(section(page, "Compare").get_by_label("Attempts per task")).to_have_value(str(ATTEMPTS))


def test_a_training_with_estimated_latents_continues_after_a_restart(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    estimation = server.wait_for_job(server.request("POST", "/v1/iplw", {**SHORT, "task": "basketball"})["id"])
    page = new_page(server).open("#/train?family=basketball")
    form = fill_form(page, 100_000, 0)
    form.get_by_label("Latents", exact=True).select_option(estimation["id"])
    for latent in estimation["result"]["latents"]:
        expect(form.get_by_label(latent["name"])).to_have_value(f"{latent['value']:.6g}")
    form.get_by_role("button", name="Train").click()
    page.wait_for_function("() => document.querySelector('[data-series=loss]')?.dataset.points > 0")
    asked = server.request("GET", "/v1/jobs/job-2")["config"]["latents"]
    assert asked == {latent["name"]: pytest.approx(latent["value"], rel=1e-5) for latent in estimation["result"]["latents"]}
    server.kill()
    expect(page.locator(".banner")).to_be_visible()
    server.restart()
    expect(page.locator(".banner")).to_be_hidden()
    page.wait_for_function("() => document.querySelector('[data-series=loss]')?.dataset.points > 0")
    expect(form.locator(".state")).to_have_text("running")
    form.get_by_role("button", name="Cancel").click()
    expect(form.locator(".state")).to_have_text("cancelled")
