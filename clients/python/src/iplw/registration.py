"""Registers the environments with Gymnasium."""

from __future__ import annotations

import gymnasium

from .families import CONTROL_TASKS, FAMILIES


def register() -> None:
    """Registers the environments that are not registered yet; called by `import iplw`."""
    for name, family in FAMILIES.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="iplw.envs:PlacementEnv",
                vector_entry_point="iplw.vector:PlacementVectorEnv",
                kwargs={"task": family},
            )
    for name, task in CONTROL_TASKS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="iplw.control_envs:ControlEnv",
                vector_entry_point="iplw.control_envs:ControlVectorEnv",
                kwargs={"task": task},
            )
