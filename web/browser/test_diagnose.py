"""Diagnose: tracks dropped, how they are read set by looking, the name of what is missing read off."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, expect
from thrown import csv, launches

#: Counts what a hand does.
CLICKS = "addEventListener('pointerdown', () => (window.clicks = (window.clicks ?? 0) + 1), true)"
DROP = """async ([name, text]) => {
  const files = new DataTransfer();
  files.items.add(new File([text], name, { type: 'text/csv' }));
  const zone = document.querySelector('.drop');
  for (const type of ['dragenter', 'dragover', 'drop']) {
    zone.dispatchEvent(new DragEvent(type, { dataTransfer: files, bubbles: true, cancelable: true }));
  }
}"""
#: Clicks and drops within which a name is read.
MOST = 6


def drop(page: Page, name: str, text: str) -> None:
    page.locator(".drop").wait_for()
    page.evaluate(DROP, [name, text])


def run(page: Page) -> None:
    page.get_by_role("button", name="Run the diagnosis").click()


def verdict(page: Page) -> Any:
    return page.locator(".verdict")


def test_a_hidden_effect_is_named_in_six_clicks(serve: Callable[..., Any], see: Callable[..., Any]) -> None:
    page = see(serve()).open()
    page.evaluate(CLICKS)
    page.get_by_role("link", name="Diagnose", exact=True).click()
    drop(page, "throws.csv", csv(launches(14, 70)))
    expect(page.locator(".glance")).to_contain_text("14 launches, 980 samples")
    run(page)
    expect(verdict(page).locator("h2")).to_have_text("The simulation lacks quadratic drag.")
    clicks = page.evaluate("window.clicks") + 1
    print(f"open page, drop CSV, name of the effect: {clicks} clicks, the drop among them")
    assert clicks <= MOST
    expect(verdict(page)).to_contain_text("k = 0.2")


