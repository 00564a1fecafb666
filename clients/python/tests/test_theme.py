"""Colours of notebook cards and figures are those of the page and the reports."""

import re
from pathlib import Path

import pytest

import iplw
from iplw.display import chart
from iplw.display.page import STYLE
from iplw.display.theme import TOKENS, colour

TOKENS_CSS = Path(__file__).resolve().parents[3] / "src/picture/tokens.css"


def test_tokens_are_those_of_page_and_reports() -> None:
    css = TOKENS_CSS.read_text("utf-8")
    assert dict(re.findall(r"--([a-z-]+): light-dark\((#\w+, #\w+)\)", css)) == {
        name: f"{light}, {dark}" for name, (light, dark) in TOKENS.items()
    }


def test_meanings_have_their_colours_in_charts() -> None:
    html = chart.lines("residual", [("base model", [(0, 1), (1, 0)]), ("extended model", [(0, 0), (1, 0)]), ("loss", [(0, 1)])])
    assert 'stroke="var(--simulated)"' in html and 'stroke="var(--extended)"' in html and 'stroke="var(--c3)"' in html
    for name in ("simulated", "extended", "measured", "truth"):
        for value in TOKENS[name]:
            assert f"--{name}:{value}" in STYLE


def test_meanings_have_their_colours_in_figures() -> None:
    pandas = pytest.importorskip("pandas")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    points = pandas.DataFrame({"t": [0.0, 1.0], "before_y": [1.0, 2.0], "after_y": [0.0, 0.1]})
    figure, ax = pyplot.subplots()
    iplw.plot.residuals(points, ax=ax)
    by_label = {line.get_label(): line.get_color() for line in ax.get_lines()}
    assert by_label["base model"] == colour("simulated") and by_label["extended model"] == colour("extended")
    pyplot.close(figure)
