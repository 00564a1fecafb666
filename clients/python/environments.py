"""The families' part of `docs/environments.md`, made of what the server says of them; `generate.py --families` writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "environments.md"
BEGIN = "<!-- Made by `clients/python/generate.py --families`; what follows is not to be edited. -->\n"
END = "<!-- End of what is made. -->\n"

#: Quantity of a feature -> what it tells of the thing, by the bounds of the scene, m.
_FEATURES = {
    "x": "centre, from the left edge (0) to the right (1): share of {width} m",
    "y": "centre, from the floor (0) to the ceiling (1): share of {height} m",
    "radius": "radius (half the longer side, if it is no disc): share of {larger} m",
}
#: Quantity of a component -> what it sets.
_SETS = {"x": "centre, from the left", "y": "centre, from the floor", "radius": "radius", "angle": "angle"}


def document(text: str, families: Sequence[Mapping[str, Any]], tasks: Mapping[str, Mapping[str, Any]]) -> str:
    """The document with its made part as it is now. `tasks`: a family's name -> one of its tasks and its world."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    sections = [section(family, tasks[family["name"]]) for family in families]
    return f"{before}{BEGIN}\n{''.join(sections)}{END}{after}"


def asked(client: Any) -> tuple[list[dict[str, Any]], dict[str, dict[str, Any]]]:
    """The families, and of each what `document` needs."""
    families = client.tasks()
    told = {}
    for family in families:
        name = family["name"]
        scene = client.task(client.task_ids(name)[0])["scene"]
        told[name] = {"scene": scene, "world": client.world(f"{name}-sim").data}
    return families, told


def section(family: Mapping[str, Any], task: Mapping[str, Any]) -> str:
    """One family: what it is about, its spaces row by row, how an episode ends."""
    scene, world = task["scene"], task["world"]
    left, floor, right, ceiling = scene["action"]["bounds"]
    sizes = {"width": right - left, "height": ceiling - floor, "larger": max(right - left, ceiling - floor)}
    split = ", ".join(f"{count} {name}" for name, count in family["split"].items())
    names = world["observation_space"]["names"]
    components = world["action_space"]["components"]
    features = "".join(_feature(k, name, sizes) for k, name in enumerate(names))
    actions = "".join(_component(k, component) for k, component in enumerate(components))
    return f"""### `{family["gymnasium"]}`

{family["about"].capitalize()}. {family["tasks"]} tasks ({split}); a rollout lasts at most {_number(scene["steps"] * scene["time_step"])} s
({scene["steps"]} steps of {_number(1000 * scene["time_step"])} ms) and is observed every {scene["observe_every"]} steps.

`observation_space = Box(0, 1, ({len(names)},), float32)`

| index | feature | meaning |
|---|---|---|
{features}
`action_space = Box(0, 1, ({len(components)},), float32)`, or `Discrete({world["action_space"]["count"]})` {_discrete(scene["action"]["discrete"])}

| index | sets | value 0 | value 1 |
|---|---|---|---|
{actions}
Reward 1: {_goal(scene["goal"])}

"""


def _feature(index: int, name: str, sizes: Mapping[str, float]) -> str:
    thing, _, quantity = name.rpartition(".")
    meaning = _FEATURES[quantity].format(**{key: _number(size) for key, size in sizes.items()})
    return f"| {index} | `{name}` | {_words(thing)}'s {meaning} |\n"


def _component(index: int, component: Mapping[str, Any]) -> str:
    unit = "rad" if component["set"] == "angle" else "m"
    low, high = _number(component["low"]), _number(component["high"])
    return f"| {index} | {_words(component['target'])}'s {_SETS[component['set']]} | {low} {unit} | {high} {unit} |\n"


def _discrete(discrete: Mapping[str, Any]) -> str:
    if discrete["type"] == "grid":
        counts = " x ".join(map(str, discrete["counts"]))
        return f"for a grid of {counts} over the components"
    return "for points of an evenly filling sequence over the components"


def _goal(goal: Mapping[str, Any]) -> str:
    held = f" for {_number(goal['hold_s'])} s" if goal["hold_s"] else ""
    if goal["type"] == "contact":
        first, second = map(_words, goal["bodies"])
        return f"{first} and {second} touch{held}."
    if goal["type"] == "apart":
        first, second = map(_words, goal["bodies"])
        after = " after they have touched" if goal.get("after_touch") else ""
        return f"{first} and {second} do not touch{held}{after}."
    if goal["type"] == "above":
        return f"{_words(goal['body'])} is above the line that the picture marks{held}."
    return f"{_words(goal['body'])} is inside the region that the picture marks{held}."


def _words(name: str) -> str:
    return name.replace("_", " ")


def _number(value: float) -> str:
    return f"{value:.4g}"
