"""Jobs: progress, cancellation, failures with their reason, restarts of the server, pagination, order and filters, names and
notes, comparison, sharing."""

import hashlib
import json
import re
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, Route, expect

LONG = {"task": "bowling", "rounds": 200, "actions": 50, "samples": 4000, "seed": 1}
SHORT = {"task": "bowling", "rounds": 1, "actions": 2, "samples": 20, "seed": 2}


def test_jobs_continue_after_a_restart(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    job = server.request("POST", "/v1/iplw", LONG)["id"]
    page = new_page(server).open("#/jobs")
    row = page.locator(f"tr[data-job={job}]")
    expect(row).to_contain_text("Estimation")
    expect(row.locator(".state")).to_have_text("running")
    server.kill()
    expect(page.locator(".banner")).to_be_visible()
    server.restart()
    expect(page.locator(".banner")).to_be_hidden()
    expect(row.locator(".state")).to_have_text("running")
    page.get_by_role("button", name=f"Cancel {job}").click()
    expect(row.locator(".state")).to_have_text("cancelled")
    short = server.request("POST", "/v1/iplw", SHORT)["id"]
    server.wait_for_job(short)
    expect(page.locator(f"tr[data-job={short}] .state")).to_have_text("succeeded")
    page.locator(f"tr[data-job={short}]").get_by_role("link", name="Result").click()
    expect(page).to_have_url(re.compile(f"#/calibrate/{short}$"))
    page.goto(f"{server.page}/#/jobs/{short}")
    expect(page.locator(".result")).to_be_visible()
    page.get_by_role("button", name=f"Delete {short}").click()
    expect(page.locator(f"tr[data-job={job}]")).to_be_visible()
    expect(page.locator(f"tr[data-job={short}]")).to_have_count(0)


def test_a_job_is_displayed_across_a_restart(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    job = server.request("POST", "/v1/iplw", LONG)["id"]
    page = new_page(server).open(f"#/jobs/{job}")
    expect(page.locator(".state")).to_have_text("running")
    server.kill()
    expect(page.locator(".banner")).to_be_visible()
    server.restart()
    expect(page.locator(".banner")).to_be_hidden()
    server.request("DELETE", f"/v1/jobs/{job}")
    expect(page.locator(".state")).to_have_text("cancelled")


def test_ten_thousand_jobs_are_paginated(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    job = server.request("POST", "/v1/iplw", SHORT)["id"]
    server.wait_for_job(job)
    server.kill()
    copy_job(server.folder / "iplw.sqlite", 10_000)
    server.restart()
    session = new_page(server)
    page = session.open("#/play")
    answers: list[Any] = []
    page.on("response", lambda r: answers.append(r) if "/v1/jobs?" in r.url else None)
    page.locator(".badge.sim").wait_for()
    begun = time.perf_counter()
    page.get_by_role("link", name="Jobs").click()
    page.locator("tbody tr").first.wait_for()
    took = time.perf_counter() - begun
    print(f"10,000 jobs, first rows: {1e3 * took:.0f} ms")
    assert all(job["result"] is None and job["state"] == "succeeded" for job in answers[0].json()["jobs"]), "a list needs no results"
    expect(page.locator("tbody tr")).to_have_count(100)
    expect(page.get_by_text("Search and order apply to the 100 jobs of this page; older jobs are on other pages.")).to_be_visible()
    newest = page.locator("tbody tr").first.get_attribute("data-job")
    page.get_by_role("button", name="Older").click()
    page.wait_for_function(f"() => document.querySelector('tbody tr')?.dataset.job !== '{newest}'")
    expect(page.locator("tbody tr")).to_have_count(100)
    page.get_by_role("button", name="Newer").click()
    page.wait_for_function(f"() => document.querySelector('tbody tr')?.dataset.job === '{newest}'")
    page.get_by_label("State", exact=True).select_option("failed")
    expect(page.get_by_text("No job is failed.")).to_be_visible()


def test_jobs_are_sorted_and_filtered(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    server.wait_for_job(server.request("POST", "/v1/iplw", SHORT)["id"])
    server.wait_for_job(server.request("POST", "/v1/iplw", {**SHORT, "task": "basketball"})["id"])
    evaluation = {"world": "bowling-sim", "attempts": 1}
    server.wait_for_job(server.request("POST", "/v1/policies/random/evaluate", evaluation)["id"])
    page = new_page(server).open("#/jobs")
    expect_jobs(page, ["job-3", "job-2", "job-1"])
    head = page.get_by_role("columnheader", name="Name")
    head.get_by_role("button").click()
    expect(head).to_have_attribute("aria-sort", "ascending")
    expect_jobs(page, ["job-2", "job-1", "job-3"])
    head.get_by_role("button").press("Enter")
    expect(head).to_have_attribute("aria-sort", "descending")
    expect_jobs(page, ["job-3", "job-1", "job-2"])
    # The address has the order and the filters.
    page.get_by_label("Search").fill("BOWLING")
    expect_jobs(page, ["job-3", "job-1"])
    expect(page.get_by_text("2 of 3 jobs match.")).to_be_visible()
    page.get_by_label("Kind").select_option("iplw")
    expect_jobs(page, ["job-1"])
    page.reload()
    expect(page.get_by_label("Search")).to_have_value("BOWLING")
    expect_jobs(page, ["job-1"])
    page.get_by_label("Search").fill("nothing")
    expect(page.get_by_text("No job on this page contains “nothing”.")).to_be_visible()
    # A new job appears in its place, without a reload.
    page.get_by_label("Search").fill("")
    job = server.request("POST", "/v1/iplw", SHORT)["id"]
    expect_jobs(page, [job, "job-1", "job-2"])
    # Narrow screens have no heads: a row is a card, and a field sorts.
    page.set_viewport_size({"width": 390, "height": 844})
    page.get_by_label("Sort by").select_option("kind")
    expect(page.locator("thead")).to_be_hidden()
    page.get_by_label("Kind").select_option("")
    expect_jobs(page, [job, "job-2", "job-1", "job-3"])


def test_no_jobs_offer_an_example(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open("#/jobs")
    expect(page.get_by_role("heading", name="No jobs yet")).to_be_visible()
    page.get_by_role("button", name="Start an example").click()
    expect_jobs(page, ["job-1"])
    expect(page.locator("tr .state")).to_have_text("succeeded")


def test_a_name_and_a_note_survive_a_reload(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    server.wait_for_job(server.request("POST", "/v1/iplw", SHORT)["id"])
    session = new_page(server)
    add_names_and_notes(session.page, server)
    page = session.open("#/jobs/job-1")
    expect(page.get_by_role("heading", name="Estimation: bowling")).to_be_visible()
    page.get_by_role("button", name="Rename job-1").click()
    page.get_by_label("Name of job-1").fill("Without drag")
    page.get_by_label("Name of job-1").press("Escape")
    expect(page.get_by_role("heading", name="Estimation: bowling")).to_be_visible()
    page.get_by_role("button", name="Rename job-1").press("Enter")
    page.get_by_label("Name of job-1").fill("Without drag")
    page.get_by_label("Name of job-1").press("Enter")
    expect(page.get_by_role("heading", name="Without drag")).to_be_visible()
    note = page.get_by_role("region", name="Note")
    note.get_by_role("textbox").fill("Baseline: compare with linear drag.")
    expect(note.get_by_role("status")).to_have_text("Saved")
    page.reload()
    expect(page.get_by_role("heading", name="Without drag")).to_be_visible()
    expect(note.get_by_role("textbox")).to_have_value("Baseline: compare with linear drag.")
    # Both are found in the list, where the name can be changed as well; an empty one is replaced by kind and task.
    page.get_by_role("link", name="All jobs").click()
    page.get_by_label("Search").fill("baseline drag")
    row = page.locator("tr[data-job=job-1]")
    expect(row.get_by_role("link", name="Without drag")).to_be_visible()
    row.get_by_role("button", name="Rename job-1").click()
    row.get_by_label("Name of job-1").fill("")
    row.get_by_role("button", name="Save").click()
    expect(row.get_by_role("link", name="Estimation: bowling")).to_be_visible()
    page.reload()
    expect(row.get_by_role("link", name="Estimation: bowling")).to_be_visible()


def test_two_jobs_are_compared(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    of = {"task": "basketball", "rounds": 2, "actions": 2, "samples": 8}
    for seeded in ({"seed": 1}, {"seed": 2, "strategy": "informative"}):
        server.wait_for_job(server.request("POST", "/v1/iplw", {**of, **seeded})["id"])
    training = {"task": "basketball:000", "batches": 30, "validations": 2}
    for more in ({"seed": 1}, {"seed": 2, "latents": {"friction": 0.4}}):
        server.wait_for_job(server.request("POST", "/v1/policies", {**training, **more})["id"])
    page = new_page(server).open("#/jobs")
    compare = page.get_by_role("button", name="Compare")
    for job in ("job-1", "job-2"):
        expect(compare).to_be_disabled()
        page.get_by_label(f"Select {job} for a comparison").check()
    compare.click()
    expect(page).to_have_url(re.compile(r"#/jobs\?compare=job-1,job-2$"))
    for job in ("job-1", "job-2"):
        expect(page.get_by_role("region", name=job, exact=True)).to_contain_text("Estimation: basketball")
    estimates = page.get_by_role("region", name="Estimates by round")
    expect(estimates.locator("[data-latent=friction] circle.first")).to_have_count(2)
    expect(estimates.locator("[data-latent=friction] circle.second")).to_have_count(2)
    differing = page.get_by_role("region", name="Settings").locator(".differences")
    expect(differing.locator("tr[data-path=strategy]")).to_contain_text("informative")
    expect(differing.locator("tbody tr")).to_have_count(2)
    # Trainings: both curves, and nested settings.
    page.goto(f"{server.page}/#/jobs?compare=job-3,job-4")
    training_curves = page.get_by_role("region", name="Training", exact=True)
    for job in ("job-3", "job-4"):
        expect(training_curves.locator(f"[data-series='{job}']")).to_have_count(2)
    expect(differing.get_by_role("row", name="latents › friction not set 0.4")).to_be_visible()
    expect(page.get_by_role("region", name="Results")).to_contain_text("policy-4")


def test_evaluations_are_compared_and_shared(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    for seed in (0, 1):
        of = {"world": "basketball-sim", "attempts": 3, "seed": seed}
        server.wait_for_job(server.request("POST", "/v1/policies/random/evaluate", of)["id"])
    session = new_page(server)
    page = session.page
    if not has_operation(server, "get", "/v1/jobs/{id}/report"):
        page.route("**/v1/jobs/*/report", lambda route: route.fulfill(content_type="text/html", body="<!doctype html><main><h1>Evaluation</h1></main>"))
    session.open("#/jobs?compare=job-1,job-2")
    solved = page.get_by_role("region", name="Tasks solved over attempts")
    for job in ("job-1", "job-2"):
        expect(solved.locator(f"[data-series='{job}']")).to_have_attribute("data-points", "3")
    expect(solved).to_contain_text("AUCCESS of job-1 minus job-2, on the same tasks:")
    # The page of a job: its report, and the downloads.
    page.goto(f"{server.page}/#/jobs/job-1")
    expect(page.locator(".report main")).to_be_visible()
    details = page.get_by_role("region", name="Details")
    expect(details.get_by_role("row", name="attempts per task 3")).to_be_visible()
    share = page.get_by_role("group", name="Share job-1")
    with page.expect_download() as saved:
        share.get_by_role("button", name="Download report (HTML)").click()
    assert saved.value.suggested_filename == "job-1.html"
    assert "<main" in Path(saved.value.path()).read_text()
    with page.expect_download() as saved:
        share.get_by_role("button", name="Download result (JSON)").click()
    assert json.loads(Path(saved.value.path()).read_text()) == server.request("GET", "/v1/jobs/job-1")["result"]
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    share.get_by_role("button", name="Copy link").click()
    expect(share.get_by_role("status")).to_have_text("Link copied.")
    assert page.evaluate("navigator.clipboard.readText()") == page.url


def expect_jobs(page: Page, jobs: list[str]) -> None:
    """Waits until the list has these jobs in this order."""
    page.wait_for_function("(jobs) => JSON.stringify([...document.querySelectorAll('tbody tr')].map((r) => r.dataset.job)) === JSON.stringify(jobs)", arg=jobs)


def has_operation(server: Any, method: str, path: str) -> bool:
    return method in server.request("GET", "/openapi.json")["paths"].get(path, {})


def add_names_and_notes(page: Page, server: Any) -> None:
    """Adds names and notes of jobs to the responses of a server that does not have them."""
    if has_operation(server, "patch", "/v1/jobs/{id}"):
        return
    changes: dict[str, dict[str, str]] = {}

    def add(job: Any) -> Any:
        return {"name": "", "note": "", **job, **changes.get(job["id"], {})}

    def answer(route: Route) -> None:
        if route.request.method == "PATCH":
            changes.setdefault(route.request.url.split("/")[-1], {}).update(route.request.post_data_json)
            return route.fulfill(json={})
        response = route.fetch()
        if response.headers.get("content-type", "").startswith("text/event-stream"):
            lines = [f"data: {json.dumps(add(json.loads(line[5:])))}" if line.startswith("data:") else line for line in response.text().split("\n")]
            return route.fulfill(response=response, body="\n".join(lines))
        body = response.json()
        return route.fulfill(response=response, json={**body, "jobs": [add(job) for job in body["jobs"]]} if "jobs" in body else add(body))

    page.route(re.compile(r"/v1/jobs(\?.*|/job-\d+(/events)?)?$"), answer)


def copy_job(database: Any, times: int) -> None:
    """Copies the only job of a store, each copy with its own seal (defined in `src/store/seal.rs`)."""
    with sqlite3.connect(database) as store:
        store.create_function("seal_of", -1, seal_of)
        names = [row[1] for row in store.execute("PRAGMA table_info(job)") if row[1] not in ("number", "seal")]
        columns = ", ".join(names)
        row = store.execute(f"SELECT {columns} FROM job").fetchone()
        marks = ", ".join("?" for _ in names)
        store.executemany(f"INSERT INTO job ({columns}) VALUES ({marks})", [row] * times)
        store.execute(f"UPDATE job SET seal = seal_of('job', number, {columns})")


def seal_of(*values: int | str | None) -> int:
    """The first 8 bytes of a digest of the values, each with its type and length."""
    digest = hashlib.sha256()
    for value in values:
        kind, data = 0, b""
        if isinstance(value, int):
            kind, data = 1, value.to_bytes(8, "little", signed=True)
        elif isinstance(value, str):
            kind, data = 3, value.encode()
        digest.update(bytes([kind]) + len(data).to_bytes(8, "little") + data)
    return int.from_bytes(digest.digest()[:8], "little", signed=True)
