"""Scenes as the server writes them, `iplw.scene/1`, with what a notebook wants of them."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .show.drawing import drawing
from .show.page import card, number, table


class Scene(dict[str, Any]):
    """An `iplw.scene/1` document: a dict like any other, that is drawn in a notebook."""

    def placed(self, action: Sequence[float] | NDArray[Any]) -> Scene:
        """The scene with a vector action, numbers in [0, 1], carried out: everything where it is let go.

        Nothing is checked: whether it overlaps or leaves the bounds the server says (`place`, or a rollout).
        """
        components = (self.get("action") or {}).get("components", [])
        values = np.asarray(action, dtype=np.float64)
        if values.shape != (len(components),):
            raise ValueError(f"action has shape {values.shape}; allowed: ({len(components)},), a number a component")
        scene = Scene(copy.deepcopy(dict(self)))
        things = {thing["name"]: thing for thing in [*scene.get("bodies", []), *scene.get("statics", [])]}
        for component, share in zip(components, values.tolist()):
            value = component["low"] + share * (component["high"] - component["low"])
            _set(things[component["target"]], component["set"], value)
        return scene

    def draw(self, width: int = 320) -> str:
        """The scene as SVG, `width` pixels wide."""
        return drawing(self, width=width)

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        printer.text(
            f"<iplw.Scene {self.get('name', '')}: {', '.join(body['name'] for body in self.get('bodies', []))}>"
        )

    def _repr_html_(self) -> str:
        bodies = [(body["name"], body["shape"]["type"], _place(body)) for body in self.get("bodies", [])]
        effects = [
            (effect["name"], ", ".join(f"{k} = {number(v)}" for k, v in (effect.get("parameters") or {}).items()))
            for effect in self.get("effects") or []
        ]
        parts = [self.draw(), table(["body", "shape", "x, y (m)"], bodies)]
        if effects:
            parts.append(table(["effect", "parameters"], effects))
        return card(str(self.get("name", "scene")), *parts, note=str(self.get("format", "")))


def _place(body: Mapping[str, Any]) -> str:
    return ", ".join(map(number, body["position"])) if "position" in body else "–"


#: Components of an action that are one number of a vector of the body's.
_PARTS = {"x": ("position", 0), "y": ("position", 1), "vx": ("velocity", 0), "vy": ("velocity", 1)}


def _set(thing: dict[str, Any], what: str, value: float) -> None:
    if what in _PARTS:
        key, i = _PARTS[what]
        thing[key] = [value if j == i else old for j, old in enumerate(thing.get(key, [0.0, 0.0]))]
    elif what == "radius":
        thing["shape"] = {**thing["shape"], "radius": value}
    else:
        thing["angular_velocity" if what == "omega" else what] = value
