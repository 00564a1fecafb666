"""What can go wrong, as exceptions that say what to do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class IplwError(Exception):
    """Everything this package raises on its own account."""


class Problem(IplwError):
    """The server refused a request: its RFC 9457 problem details, as attributes.

    `slug` is the last part of the problem's type (`sealed`, `budget-spent`, ...); `field`, `value` and
    `allowed` are None where the problem is not about one field.
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
        """From the body of a problem response."""

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
        """`422 out of range: `latents.friction` is -1; allowed: a number from 0 to 10`, as far as known."""
        head = f"{self.status} {self.title}" if self.title else str(self.status)
        text = f"{head}: {self.detail}"
        # The detail often says it all; add only what it leaves out.
        if self.field and self.field not in self.detail:
            text += f" [field `{self.field}`" + (f" = {self.value}]" if self.value is not None else "]")
        if self.allowed and self.allowed not in self.detail:
            text += f"; allowed: {self.allowed}"
        return text

    def __reduce__(self) -> tuple[Any, ...]:
        # Exceptions cross process borders by pickle, which would drop keyword arguments.
        return (_rebuild, (self.status, self.detail, dict(self.__dict__)))


class ServerUnavailable(IplwError):
    """No server answered: it does not run, has stopped, or took longer than the timeout."""


class JobFailed(IplwError):
    """A job ended without a result. `problem` says why, if the server did."""

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
    """A command of the program ended with an error: the command, its exit code (2: bad input), and what it said."""

    def __init__(self, command: list[str], code: int, said: str) -> None:
        super().__init__(command, code, said)
        self.command = command
        self.code = code
        self.said = said

    def __str__(self) -> str:
        return f"`{' '.join(self.command)}` ended with code {self.code}: {self.said}"


class CommandKilled(IplwError):
    """A command of the program was killed by a signal, and did not end by itself."""

    def __init__(self, command: list[str], signal: str) -> None:
        super().__init__(command, signal)
        self.command = command
        self.signal = signal

    def __str__(self) -> str:
        return f"`{' '.join(self.command)}` was killed by {self.signal}"


def _rebuild(status: int, detail: str, state: dict[str, Any]) -> Problem:
    problem = Problem(status, detail)
    problem.__dict__.update(state)
    return problem
