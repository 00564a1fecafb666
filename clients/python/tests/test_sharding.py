"""Environments over several servers: bit-identical to one server and to Gymnasium's vector; partial failures are reported."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import iplw
from iplw import sharding
from iplw.envs import PlacementEnv
from iplw.binary import find_binary
from iplw.server import PrivateServer
from iplw.vector import PlacementVectorEnv
from test_vector import same

N = 5
NOISY: dict[str, Any] = {"kind": "real", "noise": 0.02, "seed": 40}
SETTINGS: list[dict[str, Any]] = [
    {"task": "bowling"},
    {"task": "basketball", "action": "discrete", "split": "test"},
    {"task": "bowling:017", "world": NOISY},
]


@pytest.fixture(scope="module")
def servers() -> Iterator[list[PrivateServer]]:
    """Two servers."""
    created = [PrivateServer(find_binary()) for _ in range(2)]
    yield created
    for server in created:
        server.stop()


@pytest.fixture
def urls(servers: list[PrivateServer]) -> list[str]:
    """One over HTTP, one over ZeroMQ; results must not depend on the transport."""
    return [servers[0].address("http"), servers[1].address("tcp")]


def single(index: int, world: Any = "sim", **settings: Any) -> PlacementEnv:
    """Environment number `index` as a single environment: its seed is the first seed plus its number."""
    separate = {**world, "seed": world["seed"] + index} if isinstance(world, dict) else world
    return PlacementEnv(world=separate, **settings)


def episode_results(envs: Any, mode: AutoresetMode) -> tuple[Any, ...]:
    """All results of some episodes."""
    response: list[Any] = [envs.reset(seed=11)]
    envs.action_space.seed(1)
    ended = np.zeros(N, np.bool_)
    for step in range(8):
        if mode is AutoresetMode.DISABLED and ended.any():
            response.append(envs.reset(options={"reset_mask": ended.copy()}))
        response.append(envs.step(envs.action_space.sample()))
        ended = response[-1][2] | response[-1][3]
        if step == 4:
            response.append(envs.reset(seed=[None, 3, None, 4, 4]))
            ended = np.zeros(N, np.bool_)
    return tuple(response)


@pytest.mark.parametrize("settings", SETTINGS, ids=["box", "discrete", "noisy"])
@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_matches_single_server_and_gymnasium(
    mode: AutoresetMode, settings: dict[str, Any], urls: list[str]
) -> None:
    makers = [partial(single, i, **settings) for i in range(N)]
    theirs = SyncVectorEnv(makers, autoreset_mode=mode)
    one = PlacementVectorEnv(N, **settings, autoreset_mode=mode)
    two = iplw.make_vec(num_envs=N, **settings, url=urls, autoreset_mode=mode)
    assert [len(share.worlds) for share in two._shards.shards] == [3, 2]
    message = [episode_results(envs, mode) for envs in (theirs, one, two)]
    same(message[0], message[2])
    same(message[1], message[2])
    for envs in (theirs, one, two):
        envs.close()


def test_images_films_and_latents_by_environment(urls: list[str]) -> None:
    pair = [
        PlacementVectorEnv(N, observation="image", render_mode="rgb_array", url=url, autoreset_mode="Disabled")
        for url in (None, urls)
    ]
    observed = []
    for envs in pair:
        envs.set_latents(restitution=[0.1, 0.3, 0.5, 0.7, 0.9])
        start = envs.reset(seed=1, options={"task": "bowling:000"})
        stepped = envs.step(np.full((N, 3), 0.4))
        films = tuple(envs.film(i, width=64, fps=10).png for i in range(N))
        assert len(set(films)) == N, "balls bounce differently"
        observed.append((start, stepped, envs.render(), films))
    same(observed[0], observed[1])
    for envs in pair:
        envs.close()


def test_queries_servers_concurrently(urls: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    envs = iplw.make_vec("bowling", N, url=urls)
    meeting = threading.Barrier(2, timeout=20)
    ask = sharding.Shard.send

    def both(share: sharding.Shard, call: Any) -> Any:
        meeting.wait()
        return ask(share, call)

    monkeypatch.setattr(sharding.Shard, "send", both)
    envs.reset(seed=1)
    envs.step(envs.action_space.sample())
    monkeypatch.undo()
    envs.close()


def test_rejected_step_changes_no_world(urls: list[str]) -> None:
    envs = iplw.make_vec("bowling", N, url=urls, autoreset_mode="Disabled")
    envs.reset(seed=1)
    actions = np.full((N, 3), 0.5)
    for invalid, field in ((0, "actions[0]"), (4, "actions[4]")):
        spoilt = actions.copy()
        spoilt[invalid, 1] = 1.5
        with pytest.raises(iplw.Problem) as caught:
            envs.step(spoilt)
        assert str(caught.value.field).startswith(field) and field in caught.value.detail
    assert [envs.world(i).interactions for i in range(N)] == [0] * N
    _, _, ended, _, infos = envs.step(actions)
    assert infos["valid"].any() and ended.any(), "it continues"
    with pytest.raises(iplw.Problem, match=r"worlds\[\d\]"):
        envs.step(actions)
    envs.reset()
    envs.close()


def test_partial_step_requires_reset(urls: list[str]) -> None:
    envs = iplw.make_vec("bowling:000", N, world={"kind": "real", "budget": 1}, url=urls)
    envs.reset(seed=1)
    attempted = np.random.default_rng(0).random((64, 3))
    with iplw.Client() as client, client.create_world("bowling:000") as world:
        good = attempted[world.rollout(attempted).valid.argmax()]
    envs.world(4).rollout([good])
    with pytest.raises(iplw.Problem) as caught:
        envs.step(np.tile(good, (N, 1)))
    assert caught.value.slug == "budget-spent"
    assert [envs.world(i).interactions for i in range(N)] == [1, 1, 1, 0, 1]
    with pytest.raises(iplw.IplwError, match="cannot step: some environments have acted and others have not.*reset all"):
        envs.step(np.tile(good, (N, 1)))
    with pytest.raises(iplw.IplwError, match="cannot reset"):
        envs.reset(options={"reset_mask": np.array([True, False, False, False, False])})
    envs.reset(seed=2)
    with pytest.raises(iplw.Problem):
        envs.step(np.tile(good, (N, 1)))
    envs.close()


def test_names_lost_server(servers: list[PrivateServer]) -> None:
    doomed = PrivateServer(find_binary())
    envs = iplw.make_vec("bowling", N, url=[servers[0].url, doomed.url], timeout=5)
    envs.reset(seed=1)
    doomed.stop()
    for _ in range(2):
        with pytest.raises(iplw.ServerUnavailable, match=f"environments 3 to 4: .*{doomed.url}"):
            envs.reset(seed=2)
    with pytest.raises(iplw.IplwError, match="cannot step.*environments 3 to 4.*or create new ones"):
        envs.step(envs.action_space.sample())
    before = {world.id for world in envs.client.worlds()}
    assert set(envs.worlds[:3]) <= before
    with iplw.Client(servers[0].url) as client:
        envs.close()
        assert not set(envs.worlds[:3]) & {world.id for world in client.worlds()}, "worlds on the other server are deleted"


def test_rejects_incompatible_servers(urls: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="url names 2 servers for 1 environments; allowed: 1 to 1"):
        iplw.make_vec("bowling", 1, url=urls)
    with pytest.raises(ValueError, match="url names 0 servers"):
        iplw.make_vec("bowling", 1, url=[])
    with pytest.raises(iplw.ServerUnavailable, match="environments 1 to 1: no iplw server"):
        iplw.make_vec("bowling", 2, url=[urls[0], "http://127.0.0.1:9"])
    request = iplw.Client.call
    versions = iter(["1.0", "2.0"])
    monkeypatch.setattr(
        iplw.Client,
        "call",
        lambda self, op, **args: {"version": next(versions)} if op == "healthz" else request(self, op, **args),
    )
    with pytest.raises(ValueError, match="servers that differ: .* has the version 2.0; allowed: 1.0"):
        iplw.make_vec("bowling", 2, url=urls)
