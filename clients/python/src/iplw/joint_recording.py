"""Recordings of joints: measured positions and commands as trials for a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


class JointRecording:
    """Episodes of one environment of a control task."""

    def __init__(self, task: Mapping[str, Any]) -> None:
        self._joints: list[str] = list(task["joints"])
        self._motors = [action["name"] for action in task["actions"]]
        self._ranges = [(action["low"], action["high"]) for action in task["actions"]]
        self._interval = float(task["interval"])
        #: By episode: positions, one more than commands.
        self._episodes: list[tuple[list[NDArray[Any]], list[NDArray[Any]]]] = []

    def begin(self, position: NDArray[Any]) -> None:
        """Starts an episode at measured positions."""
        self._episodes.append(([position], []))

    def add(self, command: NDArray[Any], position: NDArray[Any]) -> None:
        """Adds a step: the command, clipped to the motors' ranges, and the positions measured at its end."""
        positions, commands = self._episodes[-1]
        commands.append(np.clip(command, *np.transpose(self._ranges)))
        positions.append(position)

    def csv(self) -> str:
        """`trial,t,JOINT,...,JOINT.command,...`: a command holds from its row to the next one. Episodes without steps are left out."""
        lines = [",".join(["trial", "t", *self._joints, *(f"{motor}.command" for motor in self._motors)])]
        for trial, (positions, commands) in enumerate(self._episodes):
            if not commands:
                continue
            for k, (position, command) in enumerate(zip(positions, [*commands, commands[-1]])):
                numbers = [k * self._interval, *position.tolist(), *command.tolist()]
                lines.append(",".join([str(trial), *(f"{number:.9g}" for number in numbers)]))
        return "\n".join(lines) + "\n"
