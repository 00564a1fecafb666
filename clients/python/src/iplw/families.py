"""Ids under which Gymnasium finds the environments -> families. Made by `generate.py` from what the server says of them."""

from __future__ import annotations

FAMILIES: dict[str, str] = {
    "iplw/Bowling-v0": "bowling",
    "iplw/Basketball-v0": "basketball",
}
