"""The vector environment compared with `gymnasium.vector.SyncVectorEnv`: bit-identical over every transport."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import iplw
from iplw.envs import PlacementEnv
from iplw.vector import PlacementVectorEnv

URLS = [None, "tcp://private"]
N = 6


@pytest.fixture(params=URLS, ids=["http", "zmq"])
def url(request: pytest.FixtureRequest) -> str | None:
    return request.param  # type: ignore[no-any-return]


def both(
    mode: AutoresetMode, url: str | None, n: int = N, **settings: Any
) -> Iterator[tuple[SyncVectorEnv, PlacementVectorEnv]]:
    """Gymnasium's vector of the single environment, over HTTP, and ours."""
    theirs = SyncVectorEnv([lambda: PlacementEnv(**settings) for _ in range(n)], autoreset_mode=mode)
    ours = PlacementVectorEnv(n, **settings, url=url, autoreset_mode=mode)
    yield theirs, ours
    theirs.close()
    ours.close()


def same(a: Any, b: Any, where: str = "") -> None:
    """Recursive equality of values and types."""
    assert type(a) is type(b), where
    if isinstance(a, dict):
        assert a.keys() == b.keys(), where
        for key in a:
            same(a[key], b[key], f"{where}.{key}")
    elif isinstance(a, tuple):
        assert len(a) == len(b), where
        for i, (x, y) in enumerate(zip(a, b)):
            same(x, y, f"{where}[{i}]")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype and a.shape == b.shape, where
        if a.dtype == object:
            for i, (x, y) in enumerate(zip(a, b)):
                same(x, y, f"{where}[{i}]")
        else:
            np.testing.assert_array_equal(a, b, where)
    else:
        assert a == b, where


SETTINGS: list[dict[str, Any]] = [
    {"task": "bowling"},
    {"task": "basketball", "action": "discrete", "split": "test"},
    {"task": "bowling:017", "world": {"kind": "sim", "damping": 0.8}},
]


@pytest.mark.parametrize("settings", SETTINGS, ids=["box", "discrete", "one task"])
@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_matches_gymnasium_vector(mode: AutoresetMode, settings: dict[str, Any], url: str | None) -> None:
    for theirs, ours in both(mode, url, **settings):
        assert ours.observation_space == theirs.observation_space
        assert ours.single_observation_space == theirs.single_observation_space
        assert ours.action_space == theirs.action_space
        assert ours.single_action_space == theirs.single_action_space
        assert ours.metadata == theirs.metadata and ours.metadata["autoreset_mode"] is mode
        same(theirs.reset(seed=5), ours.reset(seed=5), "reset")
        ours.action_space.seed(1)
        ended = np.zeros(N, np.bool_)
        ends = resets = 0
        for k in range(14):
            actions = ours.action_space.sample()
            if mode is AutoresetMode.DISABLED and ended.any():
                same(
                    theirs.reset(options={"reset_mask": ended.copy()}),
                    ours.reset(options={"reset_mask": ended.copy()}),
                    f"reset before step {k}",
                )
                resets += int(ended.sum())
            stepped = ours.step(actions)
            same(theirs.step(actions), stepped, f"step {k}")
            ended = stepped[2] | stepped[3]
            ends += int(ended.sum())
            if k == 7:
                seeds = [None, 3, None, 4, 4, 5]
                same(theirs.reset(seed=seeds), ours.reset(seed=seeds), "seeds")
                ended = np.zeros(N, np.bool_)
        assert ends > N, "episodes ended and restarted"


def test_final_observations_and_infos(url: str | None) -> None:
    envs = PlacementVectorEnv(N, url=url, autoreset_mode="SameStep")
    first, _ = envs.reset(seed=0)
    envs.action_space.seed(0)
    while True:
        observation, _, ended, _, infos = envs.step(envs.action_space.sample())
        if ended.any():
            break
        first = observation
    i = int(ended.argmax())
    assert np.array_equal(infos["_final_obs"], ended) and np.array_equal(infos["_final_info"], ended)
    assert infos["final_info"]["valid"][i] and infos["final_info"]["end"][i]
    assert infos["final_obs"][i] in envs.single_observation_space
    assert not np.array_equal(infos["final_obs"][i], observation[i])
    assert infos["split"][i] == "train"
    # Infos of an ended step are in final_info only.
    assert not infos.get("_valid", np.zeros(N, dtype=bool))[i]
    envs.close()


def test_images_match(url: str | None) -> None:
    for theirs, ours in both(AutoresetMode.NEXT_STEP, url, n=2, observation="image", render_mode="rgb_array"):
        same(theirs.reset(seed=1), ours.reset(seed=1))
        for k in range(3):
            actions = ours.action_space.sample()
            same(theirs.step(actions), ours.step(actions), f"step {k}")
            same(theirs.render(), ours.render(), f"render {k}")


def test_partial_reset(url: str | None) -> None:
    envs = PlacementVectorEnv(3, url=url, autoreset_mode=AutoresetMode.DISABLED)
    before, _ = envs.reset(seed=1)
    after, infos = envs.reset(seed=[9, 9, 9], options={"reset_mask": np.array([False, True, False])})
    assert np.array_equal(before[[0, 2]], after[[0, 2]]) and not np.array_equal(before[1], after[1])
    assert infos["_task"].tolist() == [False, True, False]
    for mask, error in [([True], TypeError), (np.zeros(3, bool), ValueError), (np.ones(2, bool), ValueError)]:
        with pytest.raises(error, match="reset_mask.*allowed: "):
            envs.reset(options={"reset_mask": mask})
    envs.close()


@pytest.mark.parametrize(
    "actions",
    [np.full((3, 2), 0.5), np.full((3, 3), np.nan), np.zeros(3, int), [["a"] * 3] * 3],
    ids=["shape", "nan", "discrete", "text"],
)
def test_rejects_invalid_actions_locally(actions: Any) -> None:
    envs = PlacementVectorEnv(3)
    envs.reset()
    with pytest.raises(ValueError, match="actions.*allowed: "):
        envs.step(actions)
    envs.close()


def test_rejected_step_changes_nothing(url: str | None) -> None:
    envs = PlacementVectorEnv(3, url=url)
    envs.reset(seed=1)
    actions = np.full((3, 3), 0.5)
    actions[2, 1] = 1.5
    with pytest.raises(iplw.Problem) as caught:
        envs.step(actions)
    assert caught.value.status == 422 and "actions[2]" in str(caught.value)
    assert [envs.client.world(id).interactions for id in envs.worlds] == [0, 0, 0]
    envs.close()


@pytest.mark.parametrize("name", ["iplw/Bowling-v0", "iplw/Basketball-v0", "iplw/Carom-v0", "iplw/Phyre01-v0"])
def test_make_vec(name: str, url: str | None) -> None:
    envs = gymnasium.make_vec(
        name, num_envs=4, vectorization_mode="vector_entry_point", url=url, autoreset_mode="SameStep"
    )
    assert isinstance(envs, PlacementVectorEnv) and envs.spec is not None and envs.num_envs == 4
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    # Gymnasium wrappers accept it.
    wrapped = gymnasium.wrappers.vector.RecordEpisodeStatistics(envs)
    wrapped.reset(seed=0)
    for _ in range(6):
        observation, reward, *_ = wrapped.step(wrapped.action_space.sample())
        assert observation in wrapped.observation_space and reward.shape == (4,)
    assert wrapped.episode_count > 0
    wrapped.close()
    created = iplw.make_vec(name, 2)
    assert created.spec is not None and isinstance(created, PlacementVectorEnv)
    created.close()


def test_close_deletes_worlds(client: iplw.Client, url: str | None) -> None:
    before = {world.id for world in client.worlds()}
    envs = iplw.make_vec("bowling", 5, url=url)
    assert len({world.id for world in client.worlds()} - before) == 5
    envs.close()
    envs.close()
    assert {world.id for world in client.worlds()} == before


def test_latents_by_world() -> None:
    envs = iplw.make_vec("bowling", 3)
    envs.set_latents(friction=[0.1, 0.2, 0.3], restitution=0.5)
    for id, friction in zip(envs.worlds, (0.1, 0.2, 0.3)):
        latents = envs.client.world(id).latents
        assert latents is not None and (latents["friction"], latents["restitution"]) == (friction, 0.5)
    envs.close()


@pytest.mark.parametrize(
    ("settings", "word"),
    [({"num_envs": 0}, "num_envs"), ({"observation": "pixels"}, "observation"), ({"split": "all"}, "split")],
)
def test_rejects_invalid_settings(settings: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=rf"{word} is .*; allowed: "):
        PlacementVectorEnv(**{"num_envs": 2, **settings})
