"""The frame: tokens, lost connections, and spent budgets."""

import subprocess
import urllib.request
from collections.abc import Callable
from typing import Any

from conftest import BINARY
from playwright.sync_api import expect
from test_play import film


def test_an_invalid_token_is_rejected_and_a_valid_one_accepted(serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Any) -> None:
    tokens = tmp_path / "tokens"
    made = subprocess.run([BINARY, "token", "new", "ada", "--scope", "act", "--token-file", tokens], capture_output=True, text=True, check=True)
    token = next(word for word in made.stdout.split() if word.startswith("iplw_"))
    server = serve("--token-file", str(tokens))
    page = new_page(server).open()
    dialog = page.get_by_role("dialog", name="Sign in")
    expect(dialog).to_be_visible()
    dialog.get_by_label("Token").fill("iplw_wrong")
    dialog.get_by_role("button", name="Sign in").click()
    expect(dialog.locator(".error")).to_contain_text("token")
    dialog.get_by_label("Token").fill(token)
    dialog.get_by_role("button", name="Sign in").click()
    expect(dialog).to_be_hidden()
    film(page)
    assert token not in page.url
    assert page.evaluate("JSON.stringify(localStorage)").find(token) < 0
    page.reload()
    film(page)
    page.get_by_role("button", name="Sign out").click()
    expect(page.get_by_role("dialog", name="Sign in")).to_be_visible()


def test_a_lost_connection_is_displayed_until_the_server_restarts(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    page = new_page(server).open()
    film(page)
    banner = page.locator(".banner")
    expect(banner).to_be_hidden()
    server.kill()
    page.get_by_label("friction").fill("0.3")
    expect(banner).to_be_visible()
    expect(banner).to_contain_text("Connection lost")
    server.restart()
    expect(banner).to_be_hidden()
    page.get_by_label("friction").fill("0.4")
    expect(page.locator(".errors")).to_be_empty()


def test_a_spent_budget_is_reported(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    server = serve()
    world = server.request("POST", "/v1/worlds", {"task": "bowling", "kind": "real", "budget": 1})["id"]
    page = new_page(server).open()
    film(page)
    page.get_by_label("Real world").select_option(world)
    expect(page.locator(".tally")).to_contain_text("of 1.")
    # Another client spends the budget first.
    action = server.request("GET", "/v1/tasks/bowling/0")["certificate"]["action"]
    server.request("POST", f"/v1/worlds/{world}/rollout", {"actions": [action], "task": "bowling:000"})
    page.get_by_role("button", name="Run in the real world").click()
    expect(page.locator(".error")).to_contain_text("Budget spent")
    expect(page.locator(".tally .count")).to_have_text("1")
    expect(page.get_by_role("button", name="Run in the real world")).to_be_disabled()


def test_the_views_are_grouped_in_one_row(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = new_page(serve()).open("#/jobs")
    nav = page.get_by_role("navigation", name="Views")
    expect(nav.get_by_role("link")).to_have_count(12)
    expect(nav.get_by_role("list", name="Decide").get_by_role("link")).to_have_text(["Plan", "Design", "Surface"])
    expect(nav.get_by_role("link", name="Jobs")).to_have_attribute("aria-current", "page")
    expect(page.get_by_role("button", name="Menu")).to_be_hidden()
    boxes = [link.bounding_box() for link in nav.get_by_role("link").all()]
    assert len({box["y"] for box in boxes if box}) == 1


def test_on_a_phone_a_button_unfolds_the_views(serve: Callable[..., Any], new_page: Callable[..., Any]) -> None:
    page = new_page(serve(), viewport={"width": 390, "height": 844}).open("#/jobs")
    nav = page.get_by_role("navigation", name="Views")
    menu = page.locator("header .menu")
    expect(nav).to_be_hidden()
    menu.click()
    expect(menu).to_have_attribute("aria-expanded", "true")
    expect(nav.get_by_role("link")).to_have_count(12)
    page.keyboard.press("Escape")
    expect(nav).to_be_hidden()
    expect(menu).to_be_focused()
    page.keyboard.press("Enter")
    page.keyboard.press("Tab")
    expect(nav.get_by_role("link", name="Play")).to_be_focused()
    nav.get_by_role("link", name="Plan").click()
    expect(page.locator("h1")).to_have_text("Plan")
    expect(nav).to_be_hidden()


def test_a_text_client_gets_a_plain_index(serve: Callable[..., Any]) -> None:
    with urllib.request.urlopen(serve().url) as response:
        text = response.read().decode()
    assert response.headers["Content-Type"].startswith("text/plain") and "/docs/" in text
