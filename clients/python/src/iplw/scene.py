"""Scenes (`iplw.scene/1`) with placement of actions and HTML display."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .display.drawing import drawing
from .display.page import card, number, table


class Scene(dict[str, Any]):
    """An `iplw.scene/1` document as a dict; a notebook draws it."""

    def placed(self, action: Sequence[float] | NDArray[Any]) -> Scene:
        """The initial state after placing a vector action with components in [0, 1].

        Overlaps and bounds are not checked; the server does that (operation `place`, or a rollout).
        """
        components = (self.get("action") or {}).get("components", [])
        values = np.asarray(action, dtype=np.float64)
        if values.shape != (len(components),):
            raise ValueError(f"action has shape {values.shape}; allowed: ({len(components)},), one number for each component")
        scene = Scene(copy.deepcopy(dict(self)))
        objects = {item["name"]: item for item in [*scene.get("bodies", []), *scene.get("statics", [])]}
        for component, fraction in zip(components, values.tolist()):
            value = component["low"] + fraction * (component["high"] - component["low"])
            _set(objects[component["target"]], component["set"], value)
        return scene

    def draw(self, width: int = 320) -> str:
        """The scene as SVG, `width` pixels wide."""
        return drawing(self, width=width)

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        printer.text(
            f"<iplw.Scene {self.get('name', '')}: {', '.join(body['name'] for body in self.get('bodies', []))}>"
        )

    def _repr_html_(self) -> str:
        bodies = [(body["name"], body["shape"]["type"], _position_text(body)) for body in self.get("bodies", [])]
        effects = [
            (effect["name"], ", ".join(f"{k} = {number(v)}" for k, v in (effect.get("parameters") or {}).items()))
            for effect in self.get("effects") or []
        ]
        parts = [self.draw(), table(["body", "shape", "x, y (m)"], bodies)]
        if effects:
            parts.append(table(["effect", "parameters"], effects))
        return card(str(self.get("name", "scene")), *parts, note=str(self.get("format", "")))


def _position_text(body: Mapping[str, Any]) -> str:
    return ", ".join(map(number, body["position"])) if "position" in body else "–"


#: Action component -> vector of the body and index within it.
_VECTOR_COMPONENTS = {"x": ("position", 0), "y": ("position", 1), "vx": ("velocity", 0), "vy": ("velocity", 1)}


def _set(item: dict[str, Any], quantity: str, value: float) -> None:
    if quantity in _VECTOR_COMPONENTS:
        key, i = _VECTOR_COMPONENTS[quantity]
        item[key] = [value if j == i else old for j, old in enumerate(item.get(key, [0.0, 0.0]))]
    elif quantity == "radius":
        item["shape"] = {**item["shape"], "radius": value}
    else:
        item["angular_velocity" if quantity == "omega" else quantity] = value
