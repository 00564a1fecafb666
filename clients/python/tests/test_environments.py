"""`docs/environments.md` says what is so: its tables are made of what the server says, and that is tried here."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import iplw
from iplw.envs import PlacementEnv

CLIENT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(CLIENT))

import environments  # noqa: E402

TEXT = environments.DOCUMENT.read_text()


def test_the_tables_are_as_they_would_be_made(client: iplw.Client) -> None:
    assert TEXT == environments.document(TEXT, *environments.asked(client)), "python generate.py --families"


def keys_of(table: str) -> set[str]:
    """First column of the table after these words."""
    rows = TEXT.partition(table)[2].split("\n\n")[1].splitlines()[2:]
    return {re.findall(r"`(\w+)`", row)[0] for row in rows}


@pytest.mark.parametrize("family", ["bowling", "basketball"])
def test_infos_have_the_keys_of_the_tables(family: str) -> None:
    env = PlacementEnv(family)
    _, info = env.reset(seed=1)
    assert set(info) == keys_of("`info` of `reset`:")
    env.action_space.seed(0)
    seen: dict[bool, set[str]] = {}
    for _ in range(50):
        *_, ended, _, info = env.step(env.action_space.sample())
        seen[info["valid"]] = set(info)
        if ended:
            env.reset()
    every = keys_of("`info` of `step`:")
    wanted = {True: every - {"reason"}, False: every - {"end"}}
    # Hardly any of basketball's actions cannot be placed.
    assert seen == (wanted if family == "bowling" else {valid: wanted[valid] for valid in seen})
    env.close()


def named(scene: Any, name: str) -> Any:
    """A body or static of a scene."""
    return next(thing for thing in scene["bodies"] + scene["statics"] if thing["name"] == name)


def test_features_are_shares_of_the_scene(client: iplw.Client) -> None:
    scene = client.task("bowling:017")["scene"]
    left, floor, right, ceiling = scene["action"]["bounds"]
    with client.create_world("bowling:017") as world:
        observation, _ = world.reset()
        for name, value in zip(world.data["observation_space"]["names"], observation, strict=True):
            thing, _, quantity = name.partition(".")
            body = named(scene, thing)
            wanted = {
                "x": (body["position"][0] - left) / (right - left),
                "y": (body["position"][1] - floor) / (ceiling - floor),
                "radius": body["shape"]["radius"] / max(right - left, ceiling - floor),
            }
            assert value == pytest.approx(wanted[quantity], abs=1e-12), name


@pytest.mark.parametrize(("task", "body"), [("bowling:017", "red"), ("basketball:003", "ball")])
def test_actions_are_shares_between_their_bounds(client: iplw.Client, task: str, body: str) -> None:
    with client.create_world(task) as world:
        components = world.data["action_space"]["components"]
        tried = np.random.default_rng(0).random((64, world.dimension))
        done = world.rollout(tried, trajectories=True)
        for action, rollout in zip(tried[done.valid], (r for r in done if r.valid)):
            for share, component in zip(action, components, strict=True):
                placed = component["low"] + share * (component["high"] - component["low"])
                if component["target"] == body and component["set"] in ("x", "y"):
                    start = rollout.bodies[body][0, "xy".index(component["set"])]
                    assert start == pytest.approx(placed, abs=1e-9)
