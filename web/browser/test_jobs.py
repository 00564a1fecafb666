"""Jobs: progress, cancellation, failures with their reason, restarts of the server, pagination."""

import hashlib
import re
import sqlite3
import time
from collections.abc import Callable
from typing import Any

from playwright.sync_api import expect

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
    expect(page.locator(".result")).to_contain_text("real interactions")
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
    expect(page.locator("tbody tr")).to_have_count(25)
    newest = page.locator("tbody tr").first.get_attribute("data-job")
    page.get_by_role("button", name="Older").click()
    page.wait_for_function(f"() => document.querySelector('tbody tr')?.dataset.job !== '{newest}'")
    expect(page.locator("tbody tr")).to_have_count(25)
    page.get_by_role("button", name="Newer").click()
    page.wait_for_function(f"() => document.querySelector('tbody tr')?.dataset.job === '{newest}'")
    page.get_by_label("Show").select_option("failed")
    expect(page.get_by_text("No job is failed.")).to_be_visible()


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
