"""Names under which `gymnasium.make` finds the environments; needs nothing but Gymnasium's registry."""

from __future__ import annotations

import gymnasium

from .families import FAMILIES


def register() -> None:
    """Registers what is not registered yet. `import iplw` does it."""
    for name, family in FAMILIES.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="iplw.envs:PlacementEnv",
                vector_entry_point="iplw.vector:PlacementVectorEnv",
                kwargs={"task": family},
            )
