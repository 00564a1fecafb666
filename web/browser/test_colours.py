"""Measured, simulated and extended motion have one colour each in the page, in reports, in notebook cards and in figures: read from
what Chromium renders, in both themes, and distinct for colour-blind eyes."""

import itertools
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import pandas
import pytest
from conftest import ROOT
from iplw import plot
from iplw.results import result_of
from matplotlib import pyplot
from playwright.sync_api import Page
from throws import csv, launches

#: Token -> its colour in the light and in the dark theme, `#rrggbb`.
TOKENS = {
    name: (light, dark)
    for name, light, dark in re.findall(
        r"--([a-z-]+): light-dark\((#\w+), (#\w+)\)", (ROOT / "src/picture/tokens.css").read_text("utf-8")
    )
}
#: Selectors of marks in the page's trial viewer, in reports, and in notebook cards, by token.
MARKS = {
    "page": {"simulated": ".track.before", "extended": ".track.after", "measured": ".observation"},
    "report": {"simulated": '.picture polyline[stroke-dasharray="7 4"]', "extended": ".picture polyline:not([stroke-dasharray])"},
    "card": {"simulated": 'polyline:has(title:text-is("base model"))', "extended": 'polyline:has(title:text-is("extended model"))'},
}
#: Linear RGB as seen with a missing cone (Machado, Oliveira and Fernandes 2009, severity 1).
BLINDNESS = {
    "none": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "protanopia": ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998)),
    "deuteranopia": ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.01182, 0.04294, 0.968881)),
    "tritanopia": ((1.255528, -0.076749, -0.178779), (-0.078411, 0.930809, 0.147602), (0.004733, 0.691367, 0.3039)),
}
#: Minimum distance of two colours in CIELAB, ten times a just noticeable one, and minimum contrast of graphics (WCAG 2.1, 1.4.11).
MIN_DISTANCE, MIN_CONTRAST = 23.0, 3.0


def rgb(colour: str) -> tuple[int, ...]:
    """`#rrggbb` or `rgb(r, g, b)` as numbers."""
    if colour.startswith("#"):
        return tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return tuple(int(v) for v in re.findall(r"\d+", colour)[:3])


def linear(colour: str) -> list[float]:
    return [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (v / 255 for v in rgb(colour))]


def lab(colour: str, blindness: str) -> list[float]:
    """CIELAB (D65) of a colour as seen."""
    seen = [min(1.0, max(0.0, sum(m * c for m, c in zip(row, linear(colour))))) for row in BLINDNESS[blindness]]
    weights = ((0.4124, 0.3576, 0.1805, 0.95047), (0.2126, 0.7152, 0.0722, 1.0), (0.0193, 0.1192, 0.9505, 1.08883))
    shares = [sum(w * c for w, c in zip(row, seen)) / row[3] for row in weights]
    x, y, z = (t ** (1 / 3) if t > 0.008856 else 7.787 * t + 16 / 116 for t in shares)
    return [116 * y - 16, 500 * (x - y), 200 * (y - z)]


def contrast(one: str, other: str) -> float:
    high, low = sorted((sum(w * c for w, c in zip((0.2126, 0.7152, 0.0722), linear(v))) for v in (one, other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_meanings_differ_for_all_eyes(theme: int) -> None:
    meanings = {name: TOKENS[name][theme] for name in ("measured", "simulated", "extended", "truth")}
    for blindness in BLINDNESS:
        for (one, a), (other, b) in itertools.combinations(meanings.items(), 2):
            distance = math.dist(lab(a, blindness), lab(b, blindness))
            assert distance > MIN_DISTANCE, f"{one} and {other} with {blindness}: {distance:.0f}"
    for name, colour in meanings.items():
        assert contrast(colour, TOKENS["scene"][theme]) > MIN_CONTRAST, name


def read(page: Page, selector: str) -> tuple[int, ...]:
    """The rendered stroke of the first mark that a selector finds, open shadow roots included."""
    return rgb(page.locator(selector).first.evaluate("(e) => getComputedStyle(e).stroke"))


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_each_meaning_has_one_colour(
    serve: Callable[..., Any], new_page: Callable[..., Any], tmp_path: Path, theme: int
) -> None:
    server = serve()
    job = server.request("POST", "/v1/diagnoses", {"ball": {"radius": 0.02}, "trials": csv(launches(14, 70))})["id"]
    result = server.wait_for_job(job)["result"]
    tab = new_page(server, color_scheme=("light", "dark")[theme])
    expected = {name: rgb(pair[theme]) for name, pair in TOKENS.items()}

    page = tab.open(f"#/diagnose/{job}")
    page.locator("[data-whole]").wait_for()
    page.locator("summary", has_text="Look at each trial").click()
    colours = {("page", name): read(page, selector) for name, selector in MARKS["page"].items()}
    colours |= {("embedded report", name): read(page, f"[data-report] {selector}") for name, selector in MARKS["report"].items()}
    page.goto(f"{server.url}/v1/jobs/{job}/report")
    colours |= {("report", name): read(page, selector) for name, selector in MARKS["report"].items()}
    card = tmp_path / "card.html"
    card.write_text(f"<!DOCTYPE html><html>{result_of('diagnose', result)._repr_html_()}</html>", "utf-8")
    page.goto(card.as_uri())
    colours |= {("card", name): read(page, selector) for name, selector in MARKS["card"].items()}
    tab.requests.clear()
    for (place, name), colour in colours.items():
        assert colour == expected[name], f"{name} in the {place}"


def test_figures_have_the_light_colours() -> None:
    matplotlib.use("agg")
    points = pandas.DataFrame({"t": [0.0, 1.0], "before_y": [1.0, 2.0], "after_y": [0.0, 0.1]})
    _, ax = pyplot.subplots()
    plot.residuals(points, ax=ax)
    colours = {line.get_label(): line.get_color() for line in ax.get_lines()}
    assert (colours["base model"], colours["extended model"]) == (TOKENS["simulated"][0], TOKENS["extended"][0])
