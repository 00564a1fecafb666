"""Gymnasium's wrappers work with our environments, with warnings as errors."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces, wrappers

import iplw
from iplw.families import FAMILIES
from iplw.vector import PlacementVectorEnv

Env = gymnasium.Env[Any, Any]

WRAPPERS: dict[str, Callable[[Env], Env]] = {
    "TimeLimit": lambda env: wrappers.TimeLimit(env, 3),
    "OrderEnforcing": wrappers.OrderEnforcing,
    "PassiveEnvChecker": wrappers.PassiveEnvChecker,
    "RecordEpisodeStatistics": wrappers.RecordEpisodeStatistics,
    "FlattenObservation": wrappers.FlattenObservation,
    "RescaleObservation": lambda env: wrappers.RescaleObservation(env, np.float32(-1), np.float32(1)),
    "NormalizeObservation": wrappers.NormalizeObservation,
    "FrameStackObservation": lambda env: wrappers.FrameStackObservation(env, 3),
    "TimeAwareObservation": lambda env: wrappers.TimeAwareObservation(wrappers.TimeLimit(env, 5)),
    "DelayObservation": lambda env: wrappers.DelayObservation(env, 1),
    "AddRenderObservation": wrappers.AddRenderObservation,
    "ClipAction": wrappers.ClipAction,
    "RescaleAction": lambda env: wrappers.RescaleAction(env, np.float32(-1), np.float32(1)),
    "StickyAction": lambda env: wrappers.StickyAction(env, 0.5),
    "TransformReward": lambda env: wrappers.TransformReward(env, lambda reward: 2 * float(reward) - 1),
    "ClipReward": lambda env: wrappers.ClipReward(env, 0.0, 0.5),
    "NormalizeReward": wrappers.NormalizeReward,
    "RenderCollection": wrappers.RenderCollection,
    "Autoreset": wrappers.Autoreset,
}
#: Common wrappers, from the inside out.
TOWER = [
    "OrderEnforcing",
    "TimeLimit",
    "RecordEpisodeStatistics",
    "RescaleAction",
    "ClipAction",
    "RescaleObservation",
    "FrameStackObservation",
    "FlattenObservation",
    "NormalizeObservation",
    "TransformReward",
    "NormalizeReward",
    "Autoreset",
]


@pytest.mark.parametrize("name", list(FAMILIES)[:2])
@pytest.mark.parametrize("wrapper", WRAPPERS)
def test_wrapper(name: str, wrapper: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = WRAPPERS[wrapper](gymnasium.make(name, render_mode="rgb_array"))
        play(env, resets=wrapper != "Autoreset")


def test_twelve_stacked_wrappers() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env: Env = gymnasium.make("iplw/Bowling-v0", render_mode="rgb_array")
        for wrapper in TOWER:
            env = WRAPPERS[wrapper](env)
        play(env, resets=False)


def play(env: Env, resets: bool) -> None:
    """Plays episodes and checks observations against the wrapped spaces."""
    observation, info = env.reset(seed=4)
    env.action_space.seed(4)
    ends = 0
    for _ in range(12):
        assert observation in env.observation_space and observation_kind(env) == kind(observation)
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert np.isfinite(float(reward)) and isinstance(info, dict)
        ends += terminated or truncated
        if resets and (terminated or truncated):
            observation, info = env.reset()
    assert ends >= 2
    if "episode" in info:
        assert info["episode"]["l"] >= 1
    assert env.render() is not None
    env.close()


def kind(observation: Any) -> Any:
    return observation.dtype if isinstance(observation, np.ndarray) else type(observation)


def observation_kind(env: Env) -> Any:
    space = env.observation_space
    return dict if isinstance(space, spaces.Dict) else space.dtype


def test_gymnasium_video_has_start_and_end(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env: Env = gymnasium.make("iplw/Bowling-v0", render_mode="rgb_array")
    observed: list[Any] = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recorded = wrappers.RecordVideo(env, str(tmp_path / "videos"), episode_trigger=lambda _: True)
        recorded.reset(seed=1, options={"task": "bowling:000"})
        recorded.action_space.seed(1)
        while not recorded.step(recorded.action_space.sample())[2]:
            pass
        observed = list(recorded.recorded_frames)
        recorded.close()  # type: ignore[no-untyped-call]
    assert not np.array_equal(observed[0], observed[-1]), "render shows the final state after the step"
    assert seconds_of(tmp_path / "videos" / "rl-video-episode-0.mp4") == len(observed), "one second a picture"


def seconds_of(path: Path) -> float:
    from imageio_ffmpeg import count_frames_and_secs

    return float(count_frames_and_secs(str(path))[1])


def test_gymnasium_video_of_vector_environment(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        envs = wrappers.vector.RecordVideo(
            iplw.make_vec("bowling", 4, render_mode="rgb_array"), str(tmp_path / "videos"), episode_trigger=lambda _: True
        )
        envs.reset(seed=1)
        envs.action_space.seed(1)
        for _ in range(8):
            envs.step(envs.action_space.sample())
        assert envs.recorded_frames[-1].shape == (512, 512, 3), "a grid of two by two"
        envs.close()
    videos = list((tmp_path / "videos").iterdir())
    assert len(videos) >= 2 and all(seconds_of(path) >= 1 for path in videos)


VECTORS: dict[str, Callable[[PlacementVectorEnv], Any]] = {
    "RecordEpisodeStatistics": wrappers.vector.RecordEpisodeStatistics,
    "DictInfoToList": wrappers.vector.DictInfoToList,
    "RescaleAction": lambda envs: wrappers.vector.RescaleAction(envs, np.full(3, -1, np.float32), np.ones(3, np.float32)),
    "ClipAction": wrappers.vector.ClipAction,
    "RescaleObservation": lambda envs: wrappers.vector.RescaleObservation(envs, np.float32(-1), np.float32(1)),
    "FlattenObservation": wrappers.vector.FlattenObservation,
    "NormalizeObservation": wrappers.vector.NormalizeObservation,
    "NormalizeReward": wrappers.vector.NormalizeReward,
    "ClipReward": lambda envs: wrappers.vector.ClipReward(envs, 0.0, 0.5),
}


@pytest.mark.parametrize("wrapper", VECTORS)
def test_vector_wrapper(wrapper: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        envs = VECTORS[wrapper](iplw.make_vec("bowling", 3))
        observations, infos = envs.reset(seed=4)
        envs.action_space.seed(4)
        for _ in range(8):
            assert observations in envs.observation_space
            observations, rewards, ended, truncated, infos = envs.step(envs.action_space.sample())
            assert rewards.shape == ended.shape == truncated.shape == (3,) and np.isfinite(rewards).all()
        assert isinstance(infos, list) is (wrapper == "DictInfoToList")
        envs.close()
