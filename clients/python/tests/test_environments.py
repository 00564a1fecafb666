"""The generated tables of `docs/reference/environments.md` are up to date and correct."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import iplw
from iplw.envs import PlacementEnv
from iplw.families import CONTROL_TASKS, FAMILIES
from iplw.vector import PlacementVectorEnv

CLIENT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(CLIENT))

import environments  # noqa: E402

TEXT = environments.DOCUMENT.read_text()


def test_tables_are_up_to_date() -> None:
    with iplw.Client("private", collections=["levels", "phyre"]) as client:
        expected = environments.document(TEXT, *environments.query(client))
    assert expected == TEXT, "python generate.py --families"


def keys_of(table: str) -> set[str]:
    """First column of the table after this text."""
    rows = TEXT.partition(table)[2].split("\n\n")[1].splitlines()[2:]
    return {re.findall(r"`(\w+)`", row)[0] for row in rows}


@pytest.mark.parametrize("family", ["bowling", "basketball"])
def test_infos_have_documented_keys(family: str) -> None:
    env = PlacementEnv(family)
    _, info = env.reset(seed=1)
    assert set(info) == keys_of("`info` of `reset`:")
    env.action_space.seed(0)
    observed: dict[bool, set[str]] = {}
    for _ in range(50):
        *_, ended, _, info = env.step(env.action_space.sample())
        observed[info["valid"]] = set(info)
        if ended:
            env.reset()
    every = keys_of("`info` of `step`:")
    expected = {True: every - {"reason"}, False: every - {"end"}}
    # Almost all actions of basketball are valid.
    assert observed == (expected if family == "bowling" else {valid: expected[valid] for valid in observed})
    env.close()


def test_gymnasium_lists_the_environments() -> None:
    """`pprint_registry` prints all ids below one heading; each entry point exists."""
    printed = gymnasium.pprint_registry(disable_print=True)
    assert printed is not None
    section = printed.partition("===== iplw =====\n")[2].partition("=====")[0]
    assert section.split() == sorted([*FAMILIES, *CONTROL_TASKS]) and len(FAMILIES) == 37 and len(CONTROL_TASKS) == 6
    assert max(map(len, section.splitlines())) <= 79, "fits in a terminal"
    for name in FAMILIES:
        spec = gymnasium.spec(name)
        assert gymnasium.envs.registration.load_env_creator(str(spec.entry_point)) is PlacementEnv
        assert gymnasium.envs.registration.load_env_creator(str(spec.vector_entry_point)) is PlacementVectorEnv


def named(scene: Any, name: str) -> Any:
    """A body or static object of a scene."""
    return next(item for item in scene["bodies"] + scene["statics"] if item["name"] == name)


def test_features_are_normalised(client: iplw.Client) -> None:
    scene = client.task("bowling:017")["scene"]
    remaining, floor, right, ceiling = scene["action"]["bounds"]
    with client.create_world("bowling:017") as world:
        observation, _ = world.reset()
        for name, value in zip(world.data["observation_space"]["names"], observation, strict=True):
            item, _, quantity = name.partition(".")
            body = named(scene, item)
            expected = {
                "x": (body["position"][0] - remaining) / (right - remaining),
                "y": (body["position"][1] - floor) / (ceiling - floor),
                "radius": body["shape"]["radius"] / max(right - remaining, ceiling - floor),
            }
            assert value == pytest.approx(expected[quantity], abs=1e-12), name


@pytest.mark.parametrize(("task", "body"), [("bowling:017", "red"), ("basketball:003", "ball")])
def test_actions_scale_between_bounds(client: iplw.Client, task: str, body: str) -> None:
    with client.create_world(task) as world:
        components = world.data["action_space"]["components"]
        attempted = np.random.default_rng(0).random((64, world.dimension))
        done = world.rollout(attempted, trajectories=True)
        for action, rollout in zip(attempted[done.valid], (r for r in done if r.valid)):
            for share, component in zip(action, components, strict=True):
                placed = component["low"] + share * (component["high"] - component["low"])
                if component["target"] == body and component["set"] in ("x", "y"):
                    start = rollout.bodies[body][0, "xy".index(component["set"])]
                    assert start == pytest.approx(placed, abs=1e-9)
