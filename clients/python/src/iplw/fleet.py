"""Worlds alike, spread over one server or several: each server is asked for its own, all of them at once.

World i is the same wherever it is: its seed is the first's plus i. So answers do not depend on how many servers there are.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import calls
from .call import Call
from .errors import IplwError, Problem, ServerUnavailable
from .sync import Client, World

Answer = dict[str, Any]


class Share:
    """The worlds that one server has: those from number `first` on."""

    def __init__(self, client: Client, first: int, count: int, alone: bool) -> None:
        self.client = client
        self._alone = alone
        #: Which of all worlds are here.
        self.part = slice(first, first + count)
        #: Their ids.
        self.worlds: list[str] = []
        #: What the server says of the first of them.
        self.data: Answer = {}

    def ask(self, call: Call[Answer]) -> Answer:
        """Sends a request about these worlds; an error speaks of them by their numbers among all."""
        try:
            return self.client._line.do(call)
        except Problem as problem:
            raise _numbered(problem, self.part.start) from problem
        except ServerUnavailable as error:
            if self._alone:
                raise
            raise ServerUnavailable(f"environments {self.part.start} to {self.part.stop - 1}: {error}") from error


class Fleet:
    """`count` worlds of these settings, dealt to the servers in order: world 0 is on the first, the last on the last."""

    def __init__(
        self, urls: Sequence[str | None], settings: Mapping[str, Any], count: int, timeout: float
    ) -> None:
        if not 1 <= len(urls) <= count:
            raise ValueError(f"url names {len(urls)} servers for {count} environments; allowed: 1 to {count}")
        sizes = [len(part) for part in np.array_split(np.arange(count), len(urls))]
        #: Why servers do not agree on what has happened, if so.
        self.torn: str | None = None
        self.shares: list[Share] = []
        self._threads = ThreadPoolExecutor(len(urls), "iplw-fleet") if len(urls) > 1 else None
        try:
            for url, size in zip(urls, sizes):
                first = sum(len(share.worlds) for share in self.shares)
                share = Share(Client(url, timeout=timeout), first, size, alone=len(urls) == 1)
                self.shares.append(share)
                seed = (settings.get("seed") or 0) + first
                made = share.ask(calls.create_worlds({**settings, "seed": seed}, size))
                share.worlds, share.data = list(made["worlds"]), made["world"]
            self._check_alike()
        except BaseException:
            self.close()
            raise

    @property
    def worlds(self) -> list[str]:
        """Ids of the worlds, in order; on several servers some may be the same."""
        return [id for share in self.shares for id in share.worlds]

    def world(self, index: int) -> World:
        """A handle on world number `index`, with what was said of the server's first when it was made."""
        for share in self.shares:
            if share.part.start <= index < share.part.stop:
                return World(share.client._line, {**share.data, "id": share.worlds[index - share.part.start]})
        raise IndexError(f"environment {index}; allowed: 0 to {self.shares[-1].part.stop - 1}")

    def ask(self, call: Callable[[Share], Call[Answer]], doubtful: Sequence[int] | NDArray[np.intp] = ()) -> Answer:
        """Sends each server the request about its share; the answers as one.

        If all refuse, nothing has happened. If some refuse or are lost and others did what they were asked, worlds are
        `torn` apart. `doubtful`: worlds that may be refused; their servers are asked before the others.
        """
        if self._threads is None:
            return self.shares[0].ask(call(self.shares[0]))
        doubted = {share.part.start for share in self.shares for i in doubtful if _has(share, i)}
        answers: dict[int, Answer] = {}
        for early in (True, False):
            group = [share for share in self.shares if (share.part.start in doubted) is early]
            asked = [(share, self._threads.submit(share.ask, call(share))) for share in group]
            errors: list[IplwError] = []
            for share, answer in asked:
                try:
                    answers[share.part.start] = answer.result()
                except IplwError as error:
                    errors.append(error)
            if errors:
                if answers or any(isinstance(error, ServerUnavailable) for error in errors):
                    self.torn = str(errors[0])
                raise errors[0]
        return _joined([answers[share.part.start] for share in self.shares])

    def close(self) -> None:
        """Deletes the worlds and lets the servers go, those that can be reached."""
        for share in self.shares:
            with share.client:
                if share.worlds:
                    share.client._line.forget(calls.delete_worlds(share.worlds))
        if self._threads is not None:
            self._threads.shutdown()

    def _check_alike(self) -> None:
        """Refuses servers whose worlds differ in form, or that run other versions: their bits may differ."""
        if len(self.shares) == 1:
            return
        for share in self.shares:
            version = share.client.call("healthz")["version"]
            share.data = {**share.data, "version": version}
            for key in ("version", "observation_space", "action_space"):
                if share.data[key] != self.shares[0].data[key]:
                    raise ValueError(
                        f"url names servers that differ: {share.client.url} has the {key} {share.data[key]}; "
                        f"allowed: {self.shares[0].data[key]}, as {self.shares[0].client.url} has"
                    )


def _has(share: Share, index: int | np.intp) -> bool:
    return bool(share.part.start <= index < share.part.stop)


def _joined(answers: Sequence[Answer]) -> Answer:
    """Answers of all servers as one server would have given it."""
    return {key: _one_after_another([answer[key] for answer in answers]) for key in answers[0]}


def _one_after_another(parts: Sequence[Any]) -> Any:
    if any(isinstance(part, np.ndarray) for part in parts):
        return np.concatenate([np.asarray(part) for part in parts])
    return [value for part in parts for value in part]


#: Entries of requests about many worlds.
_ENTRY = re.compile(r"\b(actions|mask|seeds|tasks|worlds)\[(\d+)\]")


def _numbered(problem: Problem, first: int) -> Problem:
    """The problem with entries counted among the worlds of all servers."""

    def among_all(text: str) -> str:
        return _ENTRY.sub(lambda entry: f"{entry[1]}[{int(entry[2]) + first}]", text)

    return Problem(
        problem.status,
        among_all(problem.detail),
        title=problem.title,
        slug=problem.slug,
        field=problem.field and among_all(problem.field),
        value=problem.value,
        allowed=problem.allowed and among_all(problem.allowed),
    )
