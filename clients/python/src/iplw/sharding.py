"""Identical worlds distributed over one or more servers, which are queried concurrently.

The seed of world i is the first seed plus i, so results do not depend on the number of servers.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import requests
from .request import Request
from .errors import IplwError, Problem, ServerUnavailable
from .sync import Client, World

Response = dict[str, Any]


class Shard:
    """The worlds on one server: `count` of them, from number `first`."""

    def __init__(self, client: Client, first: int, count: int, is_only_shard: bool) -> None:
        self.client = client
        self._is_only_shard = is_only_shard
        #: Numbers of these worlds among all.
        self.slice = slice(first, first + count)
        #: Ids of the worlds.
        self.worlds: list[str] = []
        #: Description of the first of these worlds.
        self.data: Response = {}

    def send(self, request: Request[Response]) -> Response:
        """Sends a request for these worlds; errors name worlds by their numbers among all."""
        try:
            return self.client._connection.do(request)
        except Problem as problem:
            raise _renumbered(problem, self.slice.start) from problem
        except ServerUnavailable as error:
            if self._is_only_shard:
                raise
            raise ServerUnavailable(f"environments {self.slice.start} to {self.slice.stop - 1}: {error}") from error


class ShardedWorlds:
    """`count` worlds with the same settings, assigned to the servers in contiguous blocks."""

    def __init__(
        self,
        urls: Sequence[str | None],
        settings: Mapping[str, Any],
        count: int,
        timeout: float,
        collections: Sequence[str] = (),
    ) -> None:
        if not 1 <= len(urls) <= count:
            raise ValueError(f"url names {len(urls)} servers for {count} environments; allowed: 1 to {count}")
        sizes = [len(chunk) for chunk in np.array_split(np.arange(count), len(urls))]
        #: The error after which some worlds have executed a request and others have not; None if consistent.
        self.inconsistency: str | None = None
        self.shards: list[Shard] = []
        self._threads = ThreadPoolExecutor(len(urls), "iplw-shards") if len(urls) > 1 else None
        try:
            for url, size in zip(urls, sizes):
                first = sum(len(shard.worlds) for shard in self.shards)
                client = Client(url, timeout=timeout, collections=collections)
                shard = Shard(client, first, size, is_only_shard=len(urls) == 1)
                self.shards.append(shard)
                seed = (settings.get("seed") or 0) + first
                created = shard.send(requests.create_worlds({**settings, "seed": seed}, size))
                shard.worlds, shard.data = list(created["worlds"]), created["world"]
            self._check_compatible()
        except BaseException:
            self.close()
            raise

    @property
    def worlds(self) -> list[str]:
        """Ids of the worlds, in order; different servers may use the same id."""
        return [id for shard in self.shards for id in shard.worlds]

    def world(self, index: int) -> World:
        """World number `index`, with the description of the first world of its shard."""
        for shard in self.shards:
            if shard.slice.start <= index < shard.slice.stop:
                return World(shard.client._connection, {**shard.data, "id": shard.worlds[index - shard.slice.start]})
        raise IndexError(f"environment {index}; allowed: 0 to {self.shards[-1].slice.stop - 1}")

    def send(self, request: Callable[[Shard], Request[Response]], may_fail: Sequence[int] | NDArray[np.intp] = ()) -> Response:
        """Sends each server the request for its shard and concatenates the responses.

        If all servers reject it, no world has changed. If only some do, `inconsistency` is set. `may_fail`: worlds whose
        action may be rejected; their servers are queried before the others.
        """
        if self._threads is None:
            return self.shards[0].send(request(self.shards[0]))
        first_shards = {shard.slice.start for shard in self.shards for i in may_fail if _contains(shard, i)}
        responses: dict[int, Response] = {}
        for first in (True, False):
            group = [shard for shard in self.shards if (shard.slice.start in first_shards) is first]
            pending = [(shard, self._threads.submit(shard.send, request(shard))) for shard in group]
            errors: list[IplwError] = []
            for shard, response in pending:
                try:
                    responses[shard.slice.start] = response.result()
                except IplwError as error:
                    errors.append(error)
            if errors:
                if responses or any(isinstance(error, ServerUnavailable) for error in errors):
                    self.inconsistency = str(errors[0])
                raise errors[0]
        return _concatenated([responses[shard.slice.start] for shard in self.shards])

    def close(self) -> None:
        """Deletes the worlds and closes the connections; servers that are gone are ignored."""
        for shard in self.shards:
            with shard.client:
                if shard.worlds:
                    shard.client._connection.forget(requests.delete_worlds(shard.worlds))
        if self._threads is not None:
            self._threads.shutdown()

    def _check_compatible(self) -> None:
        """Rejects servers that run different versions or whose worlds have different spaces: results could differ."""
        if len(self.shards) == 1:
            return
        for shard in self.shards:
            version = shard.client.call("healthz")["version"]
            shard.data = {**shard.data, "version": version}
            for key in ("version", "observation_space", "action_space"):
                if shard.data[key] != self.shards[0].data[key]:
                    raise ValueError(
                        f"url names servers that differ: {shard.client.url} has the {key} {shard.data[key]}; "
                        f"allowed: {self.shards[0].data[key]}, the value at {self.shards[0].client.url}"
                    )


def _contains(shard: Shard, index: int | np.intp) -> bool:
    return bool(shard.slice.start <= index < shard.slice.stop)


def _concatenated(responses: Sequence[Response]) -> Response:
    """Responses of all servers, field by field."""
    return {key: _concatenate([response[key] for response in responses]) for key in responses[0]}


def _concatenate(values: Sequence[Any]) -> Any:
    if any(isinstance(value, np.ndarray) for value in values):
        return np.concatenate([np.asarray(value) for value in values])
    return [item for value in values for item in value]


#: Array entries named in problems.
_ENTRY = re.compile(r"\b(actions|mask|seeds|tasks|worlds)\[(\d+)\]")


def _renumbered(problem: Problem, first: int) -> Problem:
    """The problem with array indices that count over all servers."""

    def renumber(text: str) -> str:
        return _ENTRY.sub(lambda entry: f"{entry[1]}[{int(entry[2]) + first}]", text)

    return Problem(
        problem.status,
        renumber(problem.detail),
        title=problem.title,
        slug=problem.slug,
        field=problem.field and renumber(problem.field),
        value=problem.value,
        allowed=problem.allowed and renumber(problem.allowed),
    )
