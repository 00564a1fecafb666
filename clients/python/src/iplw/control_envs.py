"""Gymnasium environments of control tasks: mechanisms that are driven in many steps.

    gymnasium.make("iplw/PendulumSwingUp-v0", world="real", reward="sparse")
    gymnasium.make_vec("iplw/CartPoleSwingUp-v0", num_envs=64, vectorization_mode="vector_entry_point")

An episode ends (`terminated`) by the task's condition and is `truncated` at its time limit. In `world="sim"` the physics is that of
the scene and of `effects`, whose ranges are drawn at each reset; in `world="real"` it is the task's own, which is hidden.
`info["position"]` has the measured joint positions, from which `trials()` makes a recording to diagnose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.core import RenderFrame
from gymnasium.utils import EzPickle
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from . import png
from .envs import RENDER_SIZE, Reconnecting, WorldOwner
from .joint_recording import JointRecording
from .sync import Client, ControlWorld
from .vector import AUTORESET_NAMES

#: Settings of a world in `Client.create_control_world`.
Effects = Sequence[Mapping[str, Any]]


class ControlEnv(WorldOwner, gymnasium.Env[NDArray[Any], NDArray[Any]]):
    """One environment of a control task.

    - `task`: the name of a built-in task, or an `iplw.control/1` document.
    - `world`: `sim` or `real`.
    - `reward`: `dense` or `sparse`.
    - `effects`, `noise`: physics of a simulated world, as for `ControlWorld.set_physics`.
    - `url`: the server's address; None for a private server.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}
    world: ControlWorld

    def __init__(
        self,
        task: str | Mapping[str, Any] = "pendulum_swing_up",
        world: Literal["sim", "real"] = "sim",
        *,
        reward: Literal["dense", "sparse"] = "dense",
        effects: Effects = (),
        noise: Mapping[str, float] | None = None,
        url: str | None = None,
        render_mode: str | None = None,
        timeout: float = 30.0,
        world_seed: int = 0,
    ) -> None:
        EzPickle.__init__(self, **{name: value for name, value in locals().items() if name not in ("self", "__class__")})
        self.render_mode = render_mode
        self.client, self.world = _connect(url, timeout, task, world, 1, reward, effects, noise, world_seed)
        self.metadata = {**self.metadata, "render_fps": round(1.0 / self.world.data["task"]["interval"])}
        self.observation_space, self.action_space = _spaces(self.world)
        self._recording = JointRecording(self.world.data["task"])
        self._never_reset = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts an episode."""
        super().reset(seed=seed)
        _no_options(options)
        fresh = seed is not None or self._never_reset
        draw = int(self.np_random.integers(2**32)) if fresh else None
        self._never_reset = False
        answer = self.world.reset(seed=draw)
        position = np.asarray(answer["position"])[0]
        self._recording.begin(position)
        return _observation(answer["observation"])[0], {"position": position}

    def step(self, action: NDArray[Any]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Drives the motors for the task's interval."""
        command = np.asarray(action, np.float64).reshape(1, -1)
        answer = self.world.step(command)
        position = np.asarray(answer["position"])[0]
        self._recording.add(command[0], position)
        info = {
            "success": bool(answer["success"][0]),
            "position": position,
            "velocity": np.asarray(answer["velocity"])[0],
        }
        return (
            _observation(answer["observation"])[0],
            float(answer["reward"][0]),
            bool(answer["terminated"][0]),
            bool(answer["truncated"][0]),
            info,
        )

    def trials(self) -> str:
        """All episodes so far as trials for a diagnosis: CSV with `trial`, `t`, each joint and its command."""
        return self._recording.csv()

    def set_physics(self, effects: Effects = (), noise: Mapping[str, float] | None = None) -> None:
        """Replaces the effects of a simulated world, from the next reset on, and its noise at once."""
        self.world.set_physics(effects, noise)

    def render(self) -> RenderFrame | list[RenderFrame] | None:
        """The current state, (256, 256, 3)."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() without a render mode; use gymnasium.make(..., render_mode="rgb_array")')
            return None
        return png.decode(self.world.render(width=RENDER_SIZE))


class ControlVectorEnv(Reconnecting, VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """`num_envs` environments of a control task, stepped by one request; settings as for `ControlEnv`.

    `reset(seed=...)` takes one seed, from which every environment gets its own sequence of episodes, and
    `options={"reset_mask": mask}`.
    """

    def __init__(
        self,
        num_envs: int = 1,
        task: str | Mapping[str, Any] = "pendulum_swing_up",
        world: Literal["sim", "real"] = "sim",
        *,
        reward: Literal["dense", "sparse"] = "dense",
        effects: Effects = (),
        noise: Mapping[str, float] | None = None,
        url: str | None = None,
        render_mode: str | None = None,
        timeout: float = 30.0,
        world_seed: int = 0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        EzPickle.__init__(self, **{name: value for name, value in locals().items() if name not in ("self", "__class__")})
        self.num_envs = num_envs
        self.render_mode = render_mode
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {**ControlEnv.metadata, "autoreset_mode": self._mode}
        self.client, self.world = _connect(url, timeout, task, world, num_envs, reward, effects, noise, world_seed)
        self.single_observation_space, self.single_action_space = _spaces(self.world)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._observations = np.zeros(self.observation_space.shape or (), np.float32)
        self._never_reset = True

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts episodes in all environments, or in those of `options["reset_mask"]`."""
        if seed is not None and not isinstance(seed, (int, np.integer)):
            raise ValueError("seed is a sequence; allowed: one number, from which every environment gets its own sequence")
        super().reset(seed=None if seed is None else int(seed))
        remaining = dict(options or {})
        mask = remaining.pop("reset_mask", None)
        _no_options(remaining)
        fresh = seed is not None or self._never_reset
        draw = int(self.np_random.integers(2**32)) if fresh else None
        self._never_reset = False
        answer = self.world.reset(seed=draw, mask=mask)
        chosen = np.ones(self.num_envs, np.bool_) if mask is None else np.asarray(mask, np.bool_)
        self._observations = np.where(chosen[:, None], _observation(answer["observation"]), self._observations)
        return self._observations.copy(), {"position": np.asarray(answer["position"]), "_position": chosen}

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Drives the motors of every environment for the task's interval; one that is reset ignores its action."""
        answer = self.world.step(np.asarray(actions, np.float64), autoreset=AUTORESET_NAMES[self._mode])
        terminated, truncated = (np.asarray(answer[key], np.bool_) for key in ("terminated", "truncated"))
        acted = ~np.asarray(answer["reset"], np.bool_)
        infos: dict[str, Any] = {}
        for key in ("success", "position", "velocity"):
            infos[key], infos[f"_{key}"] = np.asarray(answer[key]), acted
        if self._mode is AutoresetMode.SAME_STEP and (ends := terminated | truncated).any():
            last = np.full(self.num_envs, None, dtype=object)
            for i, row in zip(np.flatnonzero(ends).tolist(), _observation(answer["final_observation"])[ends]):
                last[i] = row
            infos["final_obs"], infos["_final_obs"] = last, ends
        self._observations = _observation(answer["observation"])
        return self._observations.copy(), np.asarray(answer["reward"], np.float64), terminated, truncated, infos

    def set_physics(self, effects: Effects = (), noise: Mapping[str, float] | None = None) -> None:
        """Replaces the effects of a simulated world, from each environment's next reset on, and its noise at once."""
        self.world.set_physics(effects, noise)

    def render(self) -> tuple[Any, ...] | None:
        """One picture for each environment, (256, 256, 3); one request for each."""
        if self.render_mode is None:
            return None
        return tuple(png.decode(self.world.render(environment=i, width=RENDER_SIZE)) for i in range(self.num_envs))

    def close_extras(self, **_: Any) -> None:
        """Deletes the world and closes the connection."""
        try:
            self.world.close()
        finally:
            self.client.close()


def _connect(
    url: str | None,
    timeout: float,
    task: str | Mapping[str, Any],
    world: str,
    count: int,
    reward: str,
    effects: Effects,
    noise: Mapping[str, float] | None,
    seed: int,
) -> tuple[Client, ControlWorld]:
    """A connection, and a world on it."""
    named: dict[str, Any] = {"task": task} if isinstance(task, str) else {"definition": task}
    physics = {"effects": list(effects), "noise": dict(noise or {})} if effects or noise else None
    client = Client(url, timeout=timeout)
    try:
        return client, client.create_control_world(**named, kind=world, count=count, reward=reward, physics=physics, seed=seed)
    except BaseException:
        client.close()
        raise


def _spaces(world: ControlWorld) -> tuple[spaces.Box, spaces.Box]:
    """Spaces of observations and actions of one environment."""

    def box(ranges: Sequence[Mapping[str, Any]]) -> spaces.Box:
        low = [-np.inf if r["low"] is None else r["low"] for r in ranges]
        high = [np.inf if r["high"] is None else r["high"] for r in ranges]
        return spaces.Box(np.asarray(low, np.float32), np.asarray(high, np.float32), dtype=np.float32)

    task = world.data["task"]
    return box(task["observations"]), box(task["actions"])


def _observation(rows: Any) -> NDArray[np.float32]:
    return np.asarray(rows, np.float64).astype(np.float32)


def _no_options(options: Mapping[str, Any] | None) -> None:
    if options:
        raise ValueError(f"options has {sorted(options)}; allowed: reset_mask of a vector environment, or none")
