"""Posterior, Plan, Design and Surface: from the form to the result, and from one to the next."""

import json
import re
from collections.abc import Callable
from typing import Any

from playwright.sync_api import Locator, Page, expect
from throws import csv, launches

#: Small plans and designs.
PLAN = {"Candidate actions": "200", "Worlds per action": "8"}
DESIGN = {"Candidate actions": "40", "Worlds": "16", "Shortlist": "4"}
REPORT = "<!doctype html><html><head><style>h2 { color: red }</style></head><body><main><header><h1>Surface</h1></header><h2>Map of the action space</h2></main></body></html>"


def section(page: Page, name: str) -> Locator:
    return page.get_by_role("region", name=name, exact=True)


def fill(page: Page, values: dict[str, str]) -> None:
    """Fills in the form, including the fields under More."""
    form = page.locator("form")
    form.wait_for()
    if form.locator("details:not([open])").count():
        form.locator("summary").click()
    for label, value in values.items():
        form.get_by_label(label, exact=True).fill(value)


def test_a_posterior_of_the_example_leads_to_a_plan_whose_actions_are_tried(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open("#/posterior")
    # Without a report the page has a table of its own.
    page.route("**/v1/jobs/*/report", lambda route: route.fulfill(status=404, body="{}", content_type="application/json"))
    expect(section(page, "Purpose")).to_contain_text("values that your measured trials allow")
    page.get_by_role("button", name="Try with six bowling trials").click()
    result = section(page, "Result")
    expect(result.locator("h2")).to_have_text("The trials identify friction, restitution and linear drag c, but not density.")
    expect(result.locator(".mark")).to_have_text("converged")
    rows = section(page, "Parameters").locator("tbody tr")
    expect(rows).to_have_count(4)
    expect(section(page, "Parameters").locator("[data-parameter=density] .mark")).to_have_text("not identified")
    job = page.url.rsplit("/", 1)[1]
    # The posterior is the default of the plan.
    result.get_by_role("link", name="Plan with this posterior").click()
    expect(page.get_by_label("Parameter samples")).to_have_value(job)
    fill(page, PLAN)
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(section(page, "Result").locator("h2")).to_contain_text("under the posterior")
    config = server.request("GET", "/v1/jobs?order=newest&limit=1&results=false")["jobs"][0]["config"]
    assert config["posterior"]["source"] == "posterior" and config["config"]["actions"] == 200
    expect(section(page, "Best actions").locator("li")).to_have_count(10)
    attempt = section(page, "Try")
    expect(attempt.locator(".badge.sim")).to_be_visible()
    expect(attempt.locator(".simulated-world")).to_contain_text(f"the mean of the samples of {job}: density")
    attempt.get_by_role("button", name="Another sample").click()
    expect(attempt.locator(".simulated-world")).to_contain_text("of 512 of")
    # Other actions are tried in place; only the real world counts.
    section(page, "Best actions").get_by_role("button", name="Try action 2").click()
    expect(attempt.locator("h2").first).to_have_text("Action 2 in bowling:003")
    # Until its film replaces the previous one, the previous buttons are inert.
    expect(attempt.locator("[aria-busy=false]")).to_have_count(1)
    expect(attempt).to_contain_text("Each run in a real world costs one interaction.")
    run = attempt.get_by_role("button", name="Run in the real world")
    expect(run).to_be_enabled()
    expect(attempt.get_by_label("Real world")).to_have_value(re.compile("bowling"))
    world = attempt.get_by_label("Real world").input_value()
    spent = server.request("GET", f"/v1/worlds/{world}")["interactions"]
    run.click()
    expect(attempt.locator(".badge.real")).to_be_visible()
    assert server.request("GET", f"/v1/worlds/{world}")["interactions"] == spent + 1
    section(page, "Best actions").get_by_role("link", name="Open action 2 in Play").click()
    expect(page).to_have_url(re.compile(r"#/play/bowling%3A003\?action="))
    expect(page.locator(".badge.sim")).to_be_visible()


def test_a_design_explains_its_experiments(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = new_page(serve()).open("#/design?task=bowling:003")
    fill(page, {**DESIGN, "Experiments": "2", "Seed": "1"})
    page.get_by_role("button", name="Design", exact=True).click()
    cards = page.locator(".experiment")
    expect(cards).to_have_count(2)
    expect(section(page, "Result").locator("h2")).to_contain_text("restitution")
    expect(cards.first).to_contain_text(re.compile(r"restitution.*It does not narrow", re.S))
    expect(cards.first.locator("strong")).to_contain_text("nats")
    cards.first.locator("summary").click()
    expect(cards.first.locator("tbody tr")).to_have_count(3)
    cards.nth(1).get_by_role("button", name="Try experiment 2").click()
    expect(section(page, "Try").locator(".badge.sim")).to_be_visible()
    expect(cards.first.get_by_role("link", name="Try in Play")).to_have_attribute("href", re.compile("#/play/bowling%3A003"))
    # Another run starts from the same values.
    page.get_by_role("link", name="Change and run again").click()
    expect(page.get_by_label("Experiments", exact=True)).to_have_value("2")
    page.go_back()
    page.get_by_role("link", name="Plan the task").click()
    expect(page.get_by_label("Task", exact=True)).to_have_value("bowling:003")


def test_a_surface_compares_latents_and_is_used_by_an_estimation(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = new_page(serve()).open("#/surface")
    page.route("**/v1/jobs/*/report", lambda route: route.fulfill(body=REPORT, content_type="text/html"))
    fill(page, {"Points": "3", "Seed": "1", "Actions per task": "100"})
    page.get_by_role("button", name="Compute the surface").click()
    expect(section(page, "Result").locator("h2")).to_contain_text("for bowling")
    expect(section(page, "Result").get_by_text("An error of one prior standard deviation")).to_have_count(2)
    # The server's report is part of the page, with its own styles and without its heading.
    expect(section(page, "Report").get_by_role("heading", name="Map of the action space")).to_have_css("color", "rgb(255, 0, 0)")
    expect(page.get_by_role("heading", level=1)).to_have_count(1)
    with page.expect_download() as saved:
        page.get_by_role("button", name="Download report (HTML)").click()
    assert saved.value.suggested_filename == "job-1.html"
    expect(page.get_by_role("link", name="Use it for an estimation")).to_have_attribute("href", "#/calibrate?task=bowling&strategy=informative&surface=surface-1")


def test_invalid_values_are_reported_at_their_fields_and_failures_with_their_reason(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open("#/plan")
    fill(page, {**PLAN, "Worlds per action": "5000"})
    page.locator("form summary").click()
    page.get_by_role("button", name="Plan", exact=True).click()
    refused = page.get_by_label("Worlds per action")
    expect(refused).to_be_focused()
    expect(refused).to_have_attribute("aria-invalid", "true")
    expect(page.locator(".field-error", has_text="from 1 to 1000")).to_be_visible()
    fill(page, {**PLAN, "Task": "bowling:999"})
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.locator(".field-error", has_text="bowling:999")).to_be_visible()
    expect(page.locator(".errors")).to_be_empty()
    # A job that fails says why; a running one can be cancelled.
    body = {"ball": {"radius": 0.02}, "trials": "trial,t,x,y\n0,0,0,1\n0,0.1,0.1,1\n", "sets": [["linear_drag"]]}
    failed = server.wait_for_job(server.request("POST", "/v1/posteriors", body)["id"])
    page.goto(f"{server.page}/#/posterior/{failed['id']}")
    expect(section(page, "The posterior").locator(".why")).to_contain_text("trials")
    expect(page.get_by_role("button", name="Cancel")).to_be_hidden()
    running = server.request("POST", "/v1/plans", {"task": "bowling:003", "actions": 50000, "draws": 1000})["id"]
    page.goto(f"{server.page}/#/plan/{running}")
    page.get_by_role("button", name="Cancel").click()
    expect(section(page, "The plan").locator("h2")).to_have_text("The plan was cancelled")
    page.get_by_role("link", name="Start another").click()
    expect(page.locator(".recent")).to_contain_text("cancelled")


def test_the_effects_of_a_scene_of_another_view_are_planned_with(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open("#/posterior")
    effects = [{"name": "linear_drag", "parameters": {"c": 0.35}}]
    scene = {"format": "iplw.scene/1", "name": "one ball, extended", "bodies": [], "effects": effects}
    page.evaluate("([scene]) => sessionStorage.setItem('iplw-scene', scene)", [json.dumps(scene)])
    page.goto(f"{server.page}/#/plan/scene")
    expect(page.get_by_role("note")).to_contain_text("simulated with the effects of “one ball, extended”: linear drag (c 0.350)")
    fill(page, PLAN)
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(section(page, "Result").locator("h2")).to_contain_text("under the prior with the scene's effects")
    expect(section(page, "Try").locator(".simulated-world")).to_contain_text("the prior means and the scene's effects: density 1.00, friction 1.00, restitution 0.500, linear drag (c 0.350)")


def test_a_calibrated_scene_of_a_task_is_a_world_to_plan_in(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open("#/posterior")
    scene = server.request("GET", "/v1/tasks/bowling/5")["scene"]
    for body in scene["bodies"]:
        body |= {"friction": 0.7, "restitution": 0.45}
    page.evaluate("([scene]) => sessionStorage.setItem('iplw-scene', scene)", [json.dumps({**scene, "name": "bowling, calibrated"})])
    page.goto(f"{server.page}/#/plan/scene")
    expect(page.get_by_role("note")).to_contain_text("planned in the world of “bowling, calibrated”: density 1.00, friction 0.700, restitution 0.450")
    fill(page, PLAN)
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(section(page, "Result").locator("h2")).to_contain_text("under the chosen world")
    expect(section(page, "Try").locator(".simulated-world")).to_contain_text("the scene's world: density 1.00, friction 0.700")
    # Another run has the same world.
    page.get_by_role("link", name="Change and run again").click()
    expect(page.get_by_label("Parameter samples").locator("option:checked")).to_contain_text("friction 0.700")


def test_the_trials_of_a_diagnosis_and_files_are_inferred_from(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    trials = csv(launches(6, 30))
    server.wait_for_job(server.request("POST", "/v1/diagnoses", {"ball": {"radius": 0.02}, "trials": trials})["id"])
    page = new_page(server).open("#/posterior?job=job-1&effects=quadratic_drag")
    for source in ("job-1", "files"):
        page.get_by_label("Measured trials").select_option(source)
        if source == "files":
            page.get_by_label("Files", exact=False).first.set_input_files({"name": "throws.csv", "mimeType": "text/csv", "buffer": trials.encode()})
        page.locator("form").get_by_label("Samples", exact=True).fill("128")
        page.get_by_role("button", name="Infer").click()
        expect(section(page, "Result").locator("h2")).to_have_text("The trials identify quadratic drag k.")
        page.goto(f"{server.page}/#/posterior?effects=quadratic_drag")
