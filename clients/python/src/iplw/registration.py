"""Registers the environments with Gymnasium."""

from __future__ import annotations

import gymnasium

from .families import FAMILIES


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
