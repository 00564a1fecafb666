"""Exceptions. Messages say what is allowed and what to do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class IplwError(Exception):
    """Base class of the exceptions of this package."""


class Problem(IplwError):
    """The server rejected a request; attributes hold its RFC 9457 problem details.

    `slug` is the last part of the problem's type (`sealed`, `budget-spent`, ...); `field`, `value` and
    `allowed` are None if the problem does not concern one field.
    """

    def __init__(
        self,
        status: int,
        detail: str,
        *,
        title: str = "",
        slug: str = "",
        field: str | None = None,
        value: str | None = None,
        allowed: str | None = None,
    ) -> None:
        super().__init__(status, detail)
        self.status = status
        self.detail = detail
        self.title = title
        self.slug = slug
        self.field = field
        self.value = value
        self.allowed = allowed

    @classmethod
    def from_json(cls, status: int, problem: Mapping[str, Any]) -> Problem:
        """Parses the body of a problem response."""

        def text(key: str) -> str | None:
            value = problem.get(key)
            return None if value is None else str(value)

        return cls(
            int(problem.get("status") or status),
            text("detail") or text("title") or "no detail given",
            title=text("title") or "",
            slug=(text("type") or "").rstrip("/").rpartition("/")[2],
            field=text("field"),
            value=text("value"),
            allowed=text("allowed"),
        )

    def __str__(self) -> str:
        """`422 out of range: `latents.friction` is -1; allowed: a number from 0 to 10`, with the parts that are known."""
        head = f"{self.status} {self.title}" if self.title else str(self.status)
        text = f"{head}: {self.detail}"
        # Add only what the detail does not contain.
        if self.field and self.field not in self.detail:
            text += f" [field `{self.field}`" + (f" = {self.value}]" if self.value is not None else "]")
        if self.allowed and self.allowed not in self.detail:
            text += f"; allowed: {self.allowed}"
        return text

    def __reduce__(self) -> tuple[Any, ...]:
        # By default, pickling an exception drops keyword arguments.
        return (_unpickle_problem, (self.status, self.detail, dict(self.__dict__)))


class ServerUnavailable(IplwError):
    """No response: the server is not running, has stopped, or took longer than the timeout."""


class JobFailed(IplwError):
    """A job failed. `problem` is the reason, if the server gave one."""

    def __init__(self, job: str, problem: Problem | None) -> None:
        super().__init__(job, problem)
        self.job = job
        self.problem = problem

    def __str__(self) -> str:
        return f"job {self.job} failed: {self.problem or 'the server gave no reason'}"


class JobCancelled(IplwError):
    """A job was cancelled before it had a result."""

    def __init__(self, job: str) -> None:
        super().__init__(job)
        self.job = job

    def __str__(self) -> str:
        return f"job {self.job} was cancelled"


class CommandFailed(IplwError):
    """A command of the program failed: the command, its exit code (2: bad input) and its error message."""

    def __init__(self, command: list[str], code: int, message: str) -> None:
        super().__init__(command, code, message)
        self.command = command
        self.code = code
        self.message = message

    def __str__(self) -> str:
        return f"`{' '.join(self.command)}` ended with code {self.code}: {self.message}"


class CommandKilled(IplwError):
    """A command of the program was killed by a signal."""

    def __init__(self, command: list[str], signal: str) -> None:
        super().__init__(command, signal)
        self.command = command
        self.signal = signal

    def __str__(self) -> str:
        return f"`{' '.join(self.command)}` was killed by {self.signal}"


def _unpickle_problem(status: int, detail: str, state: dict[str, Any]) -> Problem:
    problem = Problem(status, detail)
    problem.__dict__.update(state)
    return problem
