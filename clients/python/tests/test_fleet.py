"""Environments over several servers: the same bits as with one, and as Gymnasium's own vector; nothing half done in silence."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import iplw
from iplw import fleet
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
    """Two servers of their own."""
    made = [PrivateServer(find_binary()) for _ in range(2)]
    yield made
    for server in made:
        server.stop()


@pytest.fixture
def urls(servers: list[PrivateServer]) -> list[str]:
    """One over HTTP, one over ZeroMQ: who answers how must not show."""
    return [servers[0].address("http"), servers[1].address("tcp")]


def single(index: int, world: Any = "sim", **settings: Any) -> PlacementEnv:
    """What environment number `index` is by itself: its world's seed is the first's plus its number."""
    own = {**world, "seed": world["seed"] + index} if isinstance(world, dict) else world
    return PlacementEnv(world=own, **settings)


def everything(envs: Any, mode: AutoresetMode) -> tuple[Any, ...]:
    """All that some episodes tell."""
    told: list[Any] = [envs.reset(seed=11)]
    envs.action_space.seed(1)
    ended = np.zeros(N, np.bool_)
    for step in range(8):
        if mode is AutoresetMode.DISABLED and ended.any():
            told.append(envs.reset(options={"reset_mask": ended.copy()}))
        told.append(envs.step(envs.action_space.sample()))
        ended = told[-1][2] | told[-1][3]
        if step == 4:
            told.append(envs.reset(seed=[None, 3, None, 4, 4]))
            ended = np.zeros(N, np.bool_)
    return tuple(told)


@pytest.mark.parametrize("settings", SETTINGS, ids=["box", "discrete", "noisy"])
@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_two_servers_are_as_one_and_as_gymnasiums_own(
    mode: AutoresetMode, settings: dict[str, Any], urls: list[str]
) -> None:
    makers = [partial(single, i, **settings) for i in range(N)]
    theirs = SyncVectorEnv(makers, autoreset_mode=mode)
    one = PlacementVectorEnv(N, **settings, autoreset_mode=mode)
    two = iplw.make_vec(num_envs=N, **settings, url=urls, autoreset_mode=mode)
    assert [len(share.worlds) for share in two._fleet.shares] == [3, 2]
    said = [everything(envs, mode) for envs in (theirs, one, two)]
    same(said[0], said[2])
    same(said[1], said[2])
    for envs in (theirs, one, two):
        envs.close()


def test_pictures_films_and_latents_are_the_environments_own(urls: list[str]) -> None:
    pair = [
        PlacementVectorEnv(N, observation="image", render_mode="rgb_array", url=url, autoreset_mode="Disabled")
        for url in (None, urls)
    ]
    seen = []
    for envs in pair:
        envs.set_latents(restitution=[0.1, 0.3, 0.5, 0.7, 0.9])
        start = envs.reset(seed=1, options={"task": "bowling:000"})
        stepped = envs.step(np.full((N, 3), 0.4))
        films = tuple(envs.film(i, width=64, fps=10).png for i in range(N))
        assert len(set(films)) == N, "balls bounce differently"
        seen.append((start, stepped, envs.render(), films))
    same(seen[0], seen[1])
    for envs in pair:
        envs.close()


def test_all_servers_are_asked_at_once(urls: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    envs = iplw.make_vec("bowling", N, url=urls)
    meeting = threading.Barrier(2, timeout=20)
    ask = fleet.Share.ask

    def both(share: fleet.Share, call: Any) -> Any:
        meeting.wait()
        return ask(share, call)

    monkeypatch.setattr(fleet.Share, "ask", both)
    envs.reset(seed=1)
    envs.step(envs.action_space.sample())
    monkeypatch.undo()
    envs.close()


def test_a_refused_step_has_happened_nowhere(urls: list[str]) -> None:
    envs = iplw.make_vec("bowling", N, url=urls, autoreset_mode="Disabled")
    envs.reset(seed=1)
    actions = np.full((N, 3), 0.5)
    for wrong, field in ((0, "actions[0]"), (4, "actions[4]")):
        spoilt = actions.copy()
        spoilt[wrong, 1] = 1.5
        with pytest.raises(iplw.Problem) as caught:
            envs.step(spoilt)
        assert str(caught.value.field).startswith(field) and field in caught.value.detail
    assert [envs.world(i).interactions for i in range(N)] == [0] * N
    _, _, ended, _, infos = envs.step(actions)
    assert infos["valid"].any() and ended.any(), "it goes on"
    with pytest.raises(iplw.Problem, match=r"worlds\[\d\]"):
        envs.step(actions)
    envs.reset()
    envs.close()


def test_who_is_refused_while_others_acted_must_be_reset(urls: list[str]) -> None:
    envs = iplw.make_vec("bowling:000", N, world={"kind": "real", "budget": 1}, url=urls)
    envs.reset(seed=1)
    tried = np.random.default_rng(0).random((64, 3))
    with iplw.Client() as client, client.create_world("bowling:000") as world:
        good = tried[world.rollout(tried).valid.argmax()]
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


def test_a_server_that_is_lost_is_named(servers: list[PrivateServer]) -> None:
    doomed = PrivateServer(find_binary())
    envs = iplw.make_vec("bowling", N, url=[servers[0].url, doomed.url], timeout=5)
    envs.reset(seed=1)
    doomed.stop()
    for _ in range(2):
        with pytest.raises(iplw.ServerUnavailable, match=f"environments 3 to 4: .*{doomed.url}"):
            envs.reset(seed=2)
    with pytest.raises(iplw.IplwError, match="cannot step.*environments 3 to 4.*or make new ones"):
        envs.step(envs.action_space.sample())
    before = {world.id for world in envs.client.worlds()}
    assert set(envs.worlds[:3]) <= before
    with iplw.Client(servers[0].url) as client:
        envs.close()
        assert not set(envs.worlds[:3]) & {world.id for world in client.worlds()}, "the others' worlds are deleted"


def test_servers_that_do_not_fit_are_refused(urls: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="url names 2 servers for 1 environments; allowed: 1 to 1"):
        iplw.make_vec("bowling", 1, url=urls)
    with pytest.raises(ValueError, match="url names 0 servers"):
        iplw.make_vec("bowling", 1, url=[])
    with pytest.raises(iplw.ServerUnavailable, match="environments 1 to 1: no iplw server"):
        iplw.make_vec("bowling", 2, url=[urls[0], "http://127.0.0.1:9"])
    asked = iplw.Client.call
    versions = iter(["1.0", "2.0"])
    monkeypatch.setattr(
        iplw.Client,
        "call",
        lambda self, op, **args: {"version": next(versions)} if op == "healthz" else asked(self, op, **args),
    )
    with pytest.raises(ValueError, match="servers that differ: .* has the version 2.0; allowed: 1.0"):
        iplw.make_vec("bowling", 2, url=urls)
