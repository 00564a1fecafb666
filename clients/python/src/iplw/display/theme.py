"""Colours of notebook cards and figures: the visual language of the server's page and reports, a copy of `src/picture/tokens.css`."""

from __future__ import annotations

#: Token -> colour in light and in dark surroundings.
TOKENS: dict[str, tuple[str, str]] = {
    "back": ("#f6f7f9", "#11161c"),
    "card": ("#ffffff", "#1a212a"),
    "ink": ("#17202b", "#e7ecf2"),
    "soft": ("#52606f", "#a3b0be"),
    "line": ("#d3d9e0", "#36424f"),
    "main": ("#0a5aa8", "#80b9f6"),
    "on-main": ("#ffffff", "#0c1620"),
    "measured": ("#1a1f26", "#eef2f6"),
    "simulated": ("#b4500f", "#f5a35c"),
    "extended": ("#0b5cad", "#7db7f5"),
    "truth": ("#7a00f5", "#a347ff"),
    "good": ("#1b6e33", "#85d79b"),
    "good-back": ("#e6f4ea", "#183323"),
    "warn": ("#6b4a00", "#f2cf7a"),
    "warn-back": ("#fff2d6", "#3b3016"),
    "bad": ("#b3261e", "#ff9d94"),
    "bad-back": ("#fdecea", "#3a1f1d"),
    "scene": ("#fefefe", "#10151b"),
    "static": ("#a9b0b8", "#4d5965"),
    "static-edge": ("#6c747d", "#8894a1"),
    "goal": ("#1e7a35", "#6fcf86"),
    "shade": ("#b0241c", "#ff8a80"),
}

#: Colours of series without a meaning: light, dark.
_SERIES = (
    ("#1a7f37", "#56d364"),
    ("#0969da", "#6cb6ff"),
    ("#cf222e", "#ff7b72"),
    ("#9a6700", "#e3b341"),
    ("#8250df", "#d2a8ff"),
    ("#1b7c83", "#76e3ea"),
)


def colour(token: str) -> str:
    """The colour of a token on a light ground: `measured`, `simulated`, `extended`, `truth`, ..."""
    return TOKENS[token][0]


def custom_properties(dark: bool) -> str:
    """All colours as CSS custom properties: `--ink:#17202b;...`, and `--c0` to `--c5` for series without a meaning."""
    named = [f"--{name}:{pair[dark]}" for name, pair in TOKENS.items()]
    return ";".join(named + [f"--c{i}:{pair[dark]}" for i, pair in enumerate(_SERIES)])
