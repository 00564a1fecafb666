"""Registers the environments with Gymnasium."""

from __future__ import annotations

import gymnasium

from .families import CONTROL_TASKS, FAMILIES


def register() -> None:
    """Registers the environments that are not registered yet; called by `import iplw`."""
    for tasks, entry_point, vector_entry_point in (
        (FAMILIES, "iplw.envs:PlacementEnv", "iplw.vector:PlacementVectorEnv"),
        (CONTROL_TASKS, "iplw.control_envs:ControlEnv", "iplw.control_envs:ControlVectorEnv"),
    ):
        for name, task in tasks.items():
            if name not in gymnasium.registry:
                kwargs = {"task": task}
                gymnasium.register(name, entry_point=entry_point, vector_entry_point=vector_entry_point, kwargs=kwargs)
