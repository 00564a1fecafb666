"""Semantics of episodes: one valid action, seeded tasks, sealed real worlds."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import gymnasium
import numpy as np
import pytest

import iplw
from iplw.envs import PlacementEnv


@pytest.fixture
def env() -> Iterator[PlacementEnv]:
    env = unwrapped("iplw/Bowling-v0")
    yield env
    env.close()


def unwrapped(name: str, **settings: Any) -> PlacementEnv:
    env = gymnasium.make(name, **settings).unwrapped
    assert isinstance(env, PlacementEnv)
    return env


def draws(env: PlacementEnv, seed: int, count: int = 6) -> list[str]:
    return [env.reset(seed=seed if k == 0 else None)[1]["task"] for k in range(count)]


def actions(env: PlacementEnv, count: int = 64) -> np.ndarray[Any, Any]:
    return np.random.default_rng(0).random((count, env.world.dimension))


def valid_and_not(env: PlacementEnv) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """A valid and an invalid action of the current task."""
    attempted = actions(env)
    valid = env.rollout(attempted).valid
    assert valid.any() and not valid.all()
    return attempted[valid.argmax()], attempted[valid.argmin()]


def test_seed_determines_tasks(env: PlacementEnv) -> None:
    first, other = draws(env, 7), draws(env, 8)
    assert draws(env, 7) == first, "including resets without a seed"
    assert other != first
    assert len(set(first)) > 1
    elsewhere = unwrapped("iplw/Bowling-v0", world="real")
    assert draws(elsewhere, 7) == first, "a seed gives the same task in both worlds"
    elsewhere.close()


def test_samples_tasks_from_split(env: PlacementEnv, client: iplw.Client) -> None:
    assert set(draws(env, 1)) <= set(client.task_ids("bowling", "train"))
    _, info = env.reset(seed=1, options={"split": "test"})
    assert info["task"] in client.task_ids("bowling", "test")
    _, info = env.reset(options={"task": "bowling:003"})
    assert info["task"] == "bowling:003"
    with pytest.raises(ValueError, match="allowed: task, split"):
        env.reset(options={"taks": "bowling:003"})
    tested = unwrapped("iplw/Basketball-v0", split="test")
    assert set(draws(tested, 1)) <= set(client.task_ids("basketball", "test"))
    tested.close()


def test_valid_action_terminates_episode(env: PlacementEnv) -> None:
    env.reset(seed=2)
    good, bad = valid_and_not(env)
    _, reward, terminated, truncated, info = env.step(bad)
    assert (reward, terminated, truncated, info["valid"]) == (0.0, False, False, False)
    assert info["reason"]
    spent = env.world.interactions
    _, reward, terminated, truncated, info = env.step(good)
    assert (terminated, truncated, info["valid"]) == (True, False, True)
    assert type(reward) is float and type(terminated) is bool
    assert reward == float(info["solved"])
    assert env.world.interactions == spent + 1
    with pytest.raises(iplw.Problem) as caught:
        env.step(good)
    assert caught.value.status == 409


def test_step_matches_rollout(env: PlacementEnv) -> None:
    for seed in range(3):
        _, info = env.reset(seed=seed)
        attempted = actions(env)
        batch = env.rollout(attempted)
        index = int(batch.valid.argmax())
        _, reward, *_, info = env.step(attempted[index])
        assert reward == float(bool(batch[index].solved))
        assert info["steps"] == batch[index].steps


def test_latents_change_outcome(env: PlacementEnv) -> None:
    env.reset(seed=3)
    attempted = actions(env, 8)
    before = env.rollout(attempted, trajectories=True)
    latents = env.set_latents(restitution=0.9)
    assert latents is not None and latents["restitution"] == 0.9
    after = env.rollout(attempted, trajectories=True)
    index = int(before.valid.argmax())
    a, b = before[index].bodies["red"], after[index].bodies["red"]
    # Trajectories are equal until the first contact.
    assert np.array_equal(a[0], b[0]) and (a.shape != b.shape or not np.allclose(a, b, atol=1e-3))


def test_real_world_is_sealed() -> None:
    env = unwrapped("iplw/Basketball-v0", world="real")
    assert env.world.latents is None
    with pytest.raises(iplw.Problem) as caught:
        env.set_latents(friction=0.5)
    assert (caught.value.status, caught.value.slug) == (403, "sealed")
    env.close()


def test_world_settings() -> None:
    env = unwrapped("iplw/Bowling-v0", world={"kind": "sim", "latents": {"friction": 0.25}, "damping": 0.8})
    assert env.world.latents is not None and env.world.latents["friction"] == 0.25
    env.close()
    with pytest.raises(ValueError, match=r"world has \['latnets'\]; allowed: .*latents"):
        unwrapped("iplw/Bowling-v0", world={"kind": "sim", "latnets": {}})


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"world": "reel"}, "world"),
        ({"observation": "pixels"}, "observation"),
        ({"action": "multi"}, "action"),
        ({"image_size": 32}, "image_size"),
        ({"split": "all"}, "split"),
    ],
)
def test_rejects_invalid_settings(settings: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=rf"{word} is .*; allowed: "):
        PlacementEnv("bowling", **settings)


def test_image_observations() -> None:
    env = unwrapped("iplw/Bowling-v0", observation="image", image_size=96, render_mode="rgb_array")
    first, _ = env.reset(options={"task": "bowling:000"})
    again, _ = env.reset(options={"task": "bowling:000"})
    other, _ = env.reset(options={"task": "bowling:050"})
    assert first.shape == (96, 96, 3) and first.dtype == np.uint8
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 3, "the image is not blank"
    frame = env.render()
    assert isinstance(frame, np.ndarray) and frame.shape == (256, 256, 3)
    env.close()


def test_environments_have_separate_worlds(client: iplw.Client) -> None:
    before = {world.id for world in client.worlds()}
    a, b = unwrapped("iplw/Bowling-v0"), unwrapped("iplw/Bowling-v0")
    a.set_latents(friction=0.1)
    assert b.world.latents is not None and b.world.latents["friction"] != 0.1
    assert len({world.id for world in client.worlds()} - before) == 2
    a.close()
    b.close()
    assert {world.id for world in client.worlds()} == before


def outcome(env: gymnasium.Env[Any, Any]) -> tuple[list[float], float]:
    """Observation and reward of the first action of an episode."""
    env.reset(seed=5)
    observation, reward, *_ = env.step(np.full(env.action_space.shape or (), 0.4, np.float32))
    return observation.tolist(), float(reward)


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_connect_anew(duplicate: Any) -> None:
    world = {"kind": "sim", "damping": 0.7}
    with gymnasium.make("iplw/Carom-v0", world=world, disable_env_checker=True) as env:
        expected = outcome(env)
        with duplicate(env) as other:
            own, copied = env.unwrapped, other.unwrapped
            assert isinstance(own, PlacementEnv) and isinstance(copied, PlacementEnv)
            assert copied.spec == own.spec and copied.world.id != own.world.id
            assert outcome(other) == expected
        assert outcome(env) == expected, "the copy's end is not its own"
    with closing(iplw.make_vec("iplw/Bowling-v0", 2, world=world)) as vector, closing(duplicate(vector)) as other:
        assert isinstance(other, iplw.PlacementVectorEnv) and other.worlds != vector.worlds and other.spec == vector.spec
        for envs in (vector, other):
            envs.reset(seed=3)
        actions = np.full(vector.action_space.shape or (), 0.4, np.float32)
        (first, *_), (second, *_) = vector.step(actions), other.step(actions)
        assert (first == second).all()


def _spawned(pickled: bytes) -> tuple[list[float], float]:
    with pickle.loads(pickled) as env:
        return outcome(env)


def test_copies_in_spawned_processes() -> None:
    with gymnasium.make("iplw/Bowling-v0", disable_env_checker=True) as env:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            assert pool.apply(_spawned, (pickle.dumps(env),)) == outcome(env)


def test_collections_of_families() -> None:
    with pytest.raises(ValueError, match="allowed: a list of names, such as .'levels'."):
        iplw.Client("private", collections="levels")
    with pytest.raises(iplw.ServerUnavailable, match="--tasks nowhere` ended with code 2"):
        iplw.Client("private", collections=["nowhere"])
    with iplw.Client("private") as client:
        with pytest.raises(iplw.Problem, match="carom with `--tasks levels`"):
            gymnasium.make("iplw/Carom-v0", url=client.url)


def test_another_reset_ends_the_episode(client: iplw.Client) -> None:
    world = client.create_world("bowling")
    other = client.world(world.id)
    first = world.reset(seed=1)[1]
    second = other.reset(task="bowling:017")[1]
    assert (first["episode"], second["episode"]) == (1, 2)
    with pytest.raises(iplw.Problem, match="409 .*episode 1 has ended: another reset of this world began episode 2"):
        world.step(3)
    assert other.step(20_000)[4]["task"] == "bowling:017"
    world.close()
