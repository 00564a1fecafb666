"""Branches of rollouts with interventions."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
import pytest

import iplw
from iplw.branching import Changes

#: A ball above a plank, high above the ground; an action places a second ball.
SCENE = {
    "format": "iplw.scene/1",
    "name": "plank",
    "bodies": [
        {"name": "green", "shape": {"type": "disc", "radius": 0.5}, "position": [0, 7], "mass": 2.0, "restitution": 0},
        {"name": "red", "shape": {"type": "disc", "radius": 0.25}},
    ],
    "statics": [
        {"name": "plank", "shape": {"type": "box", "half_width": 2, "half_height": 0.25}, "position": [0, 5]},
        {"name": "ground", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}},
    ],
    "steps": 480,
    "observe_every": 12,
    "carriers": ["red"],
    "goal": {"type": "contact", "bodies": ["green", "ground"], "hold_s": 0.1, "stop": False},
    "action": {"components": [{"target": "red", "set": "x", "low": 5, "high": 9}, {"target": "red", "set": "y", "low": 1, "high": 9}]},
}


@pytest.fixture(params=["auto", "rapier"])
def world(request: pytest.FixtureRequest, client: iplw.Client) -> Iterator[iplw.World]:
    with client.create_world(scene=SCENE, engine=request.param) as world:
        world.reset()
        yield world


def test_branch_without_interventions_equals_rollout(world: iplw.World) -> None:
    first = world.rollout([[0.5, 0.5]], trajectories=True)[0]
    with world.branch(first, at=1.0) as branch:
        assert branch.at == 1.0 and set(branch.bodies) == {"green", "red"}
        same = branch.rollout()
    assert same.t is not None and first.t is not None
    assert np.array_equal(same.t, first.t) and same.steps == first.steps and same.solved == first.solved
    for name, path in first.bodies.items():
        assert np.array_equal(path, same.bodies[name])
    at = int(np.searchsorted(first.t, 1.0))
    assert np.array_equal(branch.bodies["green"].position, first.bodies["green"][at, :2])
    assert json.loads(json.dumps(branch.snapshot)) == branch.snapshot


def test_remove_and_impulse(world: iplw.World) -> None:
    first = world.rollout([[0.5, 0.5]], trajectories=True)[0]
    with world.branch(first, at=1.2) as branch:
        branch.impulse("green", (3, 0))
        branch.remove("plank")
        free = branch.rollout()
    assert not first.solved and first.t is not None and free.t is not None
    # Free fall from the plank, with horizontal velocity impulse / mass.
    at = int(np.searchsorted(first.t, 1.2))
    fallen = free.t[at:] - free.t[at]
    x, y = free.bodies["green"][at:, 0], free.bodies["green"][at:, 1]
    assert np.allclose(x - x[0], 1.5 * fallen, atol=1e-4)
    assert np.allclose(y[0] - y, 4.9 * fallen**2, atol=0.06)
    assert free.velocities["green"][at + 1, 0] == pytest.approx(1.5, abs=1e-6)
    # The other ball is unaffected.
    assert np.array_equal(free.bodies["red"], first.bodies["red"])
    # A branch of the branch includes the earlier interventions.
    with world.branch(free, at=1.5) as on:
        on.set("green", velocity=(0, 0))
        on.add({"name": "extra", "shape": {"type": "disc", "radius": 0.3}, "position": [-6, 5]}, at=1.6)
        stopped = on.rollout()
    assert np.array_equal(stopped.bodies["green"][: at + 2], free.bodies["green"][: at + 2])
    assert stopped.bodies["green"][-1, 0] < free.bodies["green"][-1, 0] - 0.2
    assert np.isnan(stopped.bodies["extra"][0]).all() and stopped.bodies["extra"][-1, 1] < 5
    assert len(on.changes) == 0, "the end of the with block clears them"


def test_batch_of_counterfactuals_is_one_request(world: iplw.World) -> None:
    action = [0.5, 0.5]
    pushes = [(0.5 * k, 0.0) for k in range(7)]
    lists = []
    for push in pushes:
        changes = Changes()
        changes.impulse("green", push, at=1.2)
        changes.remove("plank", at=1.2)
        lists.append(changes.changes)
    rollouts = world.rollout([action] * len(lists), interventions=lists, trajectories=True, batch=3)
    ends = [rollout.bodies["green"][-1, 0] for rollout in rollouts]
    assert len(rollouts) == 7 and (np.diff(ends) > 0.1).all()
    again = world.branch(rollouts[6], at=1.2).rollout()
    assert np.array_equal(again.bodies["green"], rollouts[6].bodies["green"])
    all_alike = world.rollout([action] * 3, interventions=lists[:1], trajectories=True)
    assert np.array_equal(all_alike[2].bodies["green"], rollouts[0].bodies["green"])


def test_branches_last_step_and_rejects_invalid_branches(client: iplw.Client, world: iplw.World) -> None:
    with pytest.raises(iplw.Problem) as caught:
        world.branch(at=0.5)
    assert caught.value.status == 409
    world.step([0.5, 0.5])
    branch = world.branch(at=0.5)
    branch.remove("plank")
    assert branch.rollout().solved
    with pytest.raises(iplw.Problem) as caught:
        world.branch(at=99.0)
    assert caught.value.status == 422
    branch.clear()
    branch.add({"name": "extra", "shape": {"type": "disc", "radius": 0.3}, "position": branch.bodies["red"].position.tolist()})
    with pytest.raises(iplw.Problem, match="extra overlaps red"):
        branch.rollout()
    with pytest.raises(ValueError, match="two finite numbers"):
        branch.impulse("green", (1, float("nan")))
    with pytest.raises(ValueError, match="one for each action"):
        world.rollout([[0.5, 0.5]] * 3, interventions=[[], []])
    with pytest.raises(ValueError, match="trajectories=True"):
        world.branch(world.rollout([[0.5, 0.5]])[0], at=0.5)
    with client.create_world(scene=SCENE, kind="real") as real:
        with pytest.raises(iplw.Problem) as caught:
            real.branch([0.5, 0.5], at=0.5)
        assert caught.value.status == 403


def test_branch_display(world: iplw.World) -> None:
    with world.branch([0.5, 0.5], at=1.2) as branch:
        branch.remove("red")
        sampled = branch.rollout()._repr_html_()
    assert "<svg" in sampled and "nan" not in sampled.lower()


def test_async_branch(client: iplw.Client) -> None:
    import asyncio

    async def main() -> None:
        async with iplw.AsyncClient(client.url) as awaited:
            async with await awaited.create_world(scene=SCENE) as world:
                await world.reset()
                async with await world.branch([0.5, 0.5], at=0.7) as branch:
                    branch.remove("plank")
                    assert (await branch.rollout()).solved

    asyncio.run(main())
