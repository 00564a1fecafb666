"""The client over every transport: bit-identical results, equal problems, equal fault handling."""

from __future__ import annotations

import builtins
import importlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
import zmq
from peer import peer
from router import ok, router

import iplw
from iplw import codec, frames, zeromq
from iplw.sync import connection
from iplw.transport import Backoff
from iplw.request import Request
from iplw.binary import find_binary

@pytest.fixture(params=["http-json", "http-msgpack", "zmq"])
def over(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[iplw.Client]:
    """A client of the same private server, over each transport."""
    if request.param == "http-json":
        monkeypatch.setattr(codec, "has_msgpack", lambda: False)
    with iplw.Client("tcp://private" if request.param == "zmq" else None) as client:
        yield client


#: Results of the episode over the first transport.
EPISODE: list[Any] = []


def test_episode_is_bit_identical(over: iplw.Client) -> None:
    with over.create_world("bowling", latents={"friction": 0.3}, seed=4) as world:
        got: list[Any] = [world.reset(seed=11, split="test"), world.reset()]
        rng = np.random.default_rng(0)
        actions = rng.random((40, 3))
        rollouts = world.rollout(actions, trajectories=True)
        got.append([(r.valid, r.reason, r.solved, r.steps, r.collisions, r.rolling_steps) for r in rollouts])
        got.append([r.t for r in rollouts])
        got.append([sorted(r.bodies.items()) for r in rollouts])
        got.append(world.rollout([3, 1000, 25_000]).steps)
        got.append([world.step(actions[int(k)]) for k in (rollouts.valid.argmin(), rollouts.valid.argmax())])
        got.append(world.render(width=64))
    if not EPISODE:
        EPISODE.extend(got)
    np.testing.assert_equal(got, EPISODE)


def test_problems_are_equal(over: iplw.Client) -> None:
    world = over.world("bowling-sim")
    for ask, status, words in [
        (lambda: over.world("nowhere"), 404, ["nowhere"]),
        (lambda: world.rollout([[0.5, 2.0, 0.5]], task="bowling:000"), 422, ["actions[0]", "2"]),
        (lambda: world.rollout(np.array([[0.5, 2.0, 0.5]]), task="bowling:000"), 422, ["actions[0]", "2"]),
        (lambda: over.create_world("bowling", latents={"colour": 1}), 400, ["colour"]),
        (lambda: over.world("bowling-real").set_latents(friction=0.1), 403, []),
    ]:
        with pytest.raises(iplw.Problem) as caught:
            ask()  # type: ignore[no-untyped-call]
        assert caught.value.status == status and all(w in str(caught.value) for w in words), caught.value
        assert caught.value.slug


def test_keys_are_idempotent(over: iplw.Client) -> None:
    key = f"once-{time.time_ns()}"
    first, again = over.create_world("bowling", key=key), over.create_world("bowling", key=key)
    assert first.id == again.id
    first.close()


def test_lists_jobs_and_files(over: iplw.Client, tmp_path: Path) -> None:
    assert len(over.task_ids("bowling", "test")) == 20
    assert over.task("bowling:017")["id"] == "bowling:017"
    job = over.iplw("bowling", real={"damping": 0.8}, rounds=1, actions=2, samples=20, seed=1)
    result = job.wait(timeout=120)
    assert result["real_interactions"] == len(job.trials()) > 0
    assert [round["latents"] for round in job.rounds()] == [result["latents"]]
    job.save_trials(tmp_path)
    assert (tmp_path / "trials.csv").read_text().startswith("trial,")
    assert json.loads((tmp_path / "scene.json").read_text())["format"] == "iplw.scene/1"


def test_ask_tell_job(over: iplw.Client) -> None:
    job = over.iplw("bowling", real="ask_tell", rounds=1, actions=2, samples=20)
    assert isinstance(job, iplw.AskTellJob)
    proposals = job.proposals(timeout=60)
    job.tell(proposals[0], [0.0, 0.1], {"red": [[1.0, 1.0], [1.0, 0.9]]})
    row = f"{proposals[1].number},0.0,red,1.0,1.0\n{proposals[1].number},0.1,red,1.0,0.9\n"
    job.tell_csv("trial,t,body,x,y\n" + row)
    with pytest.raises(iplw.Problem):
        job.tell_csv("trial,t,body\n")
    job.cancel()


def test_uploads_and_downloads_weights(over: iplw.Client, client: iplw.Client) -> None:
    created = client.train("bowling:002", batches=1, batch_size=2, seed=1).wait()["policy"]
    weights = client.policy(created).download()
    copy = over.upload_policy("over", weights)
    assert copy.download() == weights and copy.act("bowling:001", 2)
    copy.delete()


def test_threads_share_client(over: iplw.Client) -> None:
    invalid: list[Any] = []

    def act(number: int) -> None:
        with over.create_world("bowling") as world:
            for seed in range(number, number + 20):
                task = world.reset(seed=seed)[1]["task"]
                if task != world.reset(seed=seed)[1]["task"] or over.world(world.id).id != world.id:
                    invalid.append(seed)

    threads = [threading.Thread(target=act, args=(n,)) for n in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not invalid


def test_forked_child_uses_own_connections(over: iplw.Client) -> None:
    with iplw.Client(over.url) as separate:
        separate.worlds()
        pid = os.fork()
        if pid == 0:
            good = False
            try:
                good = all(separate.world("bowling-sim").reset(seed=k) for k in range(20))
            finally:
                os._exit(0 if good else 1)
        for k in range(20):
            separate.world("bowling-real").reset(seed=k)
        assert os.waitpid(pid, 0)[1] == 0


def test_unix_socket(tmp_path: Path) -> None:
    address = f"ipc://{tmp_path}/socket"
    command = [str(find_binary()), "serve", "--http", "127.0.0.1:0", "--zmq", address, "--exit-with-stdin"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None and server.stdin is not None
        lines = [server.stdout.readline(), server.stdout.readline()]
        assert lines[1] == f"listening on {address}\n"
        with iplw.Client(address) as client, client.create_world("bowling") as world:
            world.reset(seed=1)
            assert world.step(20_000)[4]["task"]
        server.stdin.close()
        assert server.wait(10) == 0


# --- faults over ZeroMQ; over HTTP see test_client.py ---


def test_unreachable_server() -> None:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        client = iplw.Client(f"tcp://127.0.0.1:{held.getsockname()[1]}", timeout=20)
        start = time.monotonic()
        with pytest.raises(iplw.ServerUnavailable, match=r"no iplw server at tcp://.*iplw serve --zmq"):
            client.worlds()
        assert time.monotonic() - start < 5, "a refused connection fails at once"


@pytest.mark.parametrize("url", ["tcp://127.0.0.1", "tcp://", "ipc://", "udp://127.0.0.1:1", "http://"])
def test_rejects_malformed_addresses(url: str) -> None:
    with pytest.raises(ValueError, match="allowed: an address like"):
        iplw.Client(url)


def test_http_is_not_zeromq() -> None:
    with iplw.Client() as client:
        other = iplw.Client(client.url.replace("http://", "tcp://"), timeout=0.5)
        with pytest.raises(iplw.ServerUnavailable, match="no iplw server at tcp://"):
            other.worlds()


def test_timeout_cancels_request() -> None:
    with router(lambda header: None) as (url, observed):
        client = iplw.Client(url, timeout=0.3)
        with pytest.raises(iplw.ServerUnavailable, match=r"no answer to list_worlds .* within 0.3 s; increase"):
            client.worlds()
        until = time.monotonic() + 5
        while len(observed) < 2 and time.monotonic() < until:
            time.sleep(0.01)
    assert [header["op"] for header in observed] == ["list_worlds", "cancel"]
    assert observed[1]["args"] == {"request": observed[0]["id"]}


def test_retries_busy_server(monkeypatch: pytest.MonkeyPatch) -> None:
    busy = {"type": "https://iplw.dev/problems/busy", "title": "busy", "status": 503, "detail": "later"}

    def answer(header: dict[str, Any]) -> list[bytes]:
        if len(requested) < 4:
            requested.append(header["op"])
            return [msgpack.packb({"v": 1, "id": header["id"], "ok": False, "problem": busy})]
        return ok(header, {"id": "w", "kind": "sim"})

    requested: list[str] = []
    with router(answer) as (url, observed):
        assert iplw.Client(url).create_world("bowling").id == "w"
        assert len(observed) == 5
    requested.clear()
    with router(lambda h: [msgpack.packb({"v": 1, "id": h["id"], "ok": False, "problem": busy})]) as (url, observed):
        monkeypatch.setattr(connection, "Backoff", lambda timeout: Backoff(0.2))
        with pytest.raises(iplw.Problem, match="503 busy: later"):
            iplw.Client(url).create_world("bowling")
        assert len(observed) > 1


def test_slow_request_is_kept_alive_by_pings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zeromq, "PING_AFTER_S", 0.1)
    held: list[dict[str, Any]] = []

    def answer(header: dict[str, Any]) -> list[bytes] | None:
        if header["op"] == "ping" and len(held) < 25:
            held.append(header)
            return ok(header, {"pong": True})
        if header["op"] == "ping":
            return ok({"id": 1}, {"results": []})
        return None

    with router(answer) as (url, _):
        client = iplw.Client(url, timeout=2.0)
        assert client._connection.do(Request("rollout_world", {"id": "w"}, lambda a: a, extra_timeout_s=30)) == {"results": []}
    assert len(held) == 25, "longer than the timeout, but never silent"


def test_invalid_replies() -> None:
    for reply in [[b"\xc1"], [msgpack.packb({"id": 1})], [msgpack.packb(3)]]:
        with router(lambda header, reply=reply: reply) as (url, _):
            with pytest.raises(iplw.ServerUnavailable, match="is it the ZeroMQ address"):
                iplw.Client(url, timeout=5).worlds()


def test_arrays_round_trip() -> None:
    sent = {
        "actions": np.arange(6, dtype=">f4").reshape(2, 3)[:, ::-1],
        "mask": np.array([True, False]),
        "weights": b"abc",
        "n": np.int64(3),
    }
    head, *rest = frames.encode_request(7, Request("step_worlds", sent, lambda a: a, raw_arrays=True))
    header = msgpack.unpackb(head)
    assert header["args"] == {"n": 3} and header["raw"] is True
    reply = {"id": 7, "ok": True, "result": {"deep": [{}]}, "arrays": header["arrays"]}
    reply["arrays"][0]["name"] = "deep.0.actions"
    back = frames.decode_reply(reply, [b"", *(bytes(frame) for frame in rest)], binary=False)
    np.testing.assert_array_equal(back["deep"][0]["actions"], sent["actions"])
    np.testing.assert_array_equal(back["mask"], sent["mask"])
    assert back["weights"].tobytes() == b"abc"
    packed = codec.unpack(codec.pack({"a": sent["actions"], "b": [sent["mask"]]}))
    np.testing.assert_array_equal(packed["a"], sent["actions"])
    assert packed["b"][0].dtype == np.bool_


def test_missing_dependencies_give_install_hint(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.split(".")[0] == "msgpack":
            raise ImportError("No module named 'msgpack'")
        return real(name, *args, **kwargs)

    monkeypatch.delitem(sys.modules, "iplw.frames")
    monkeypatch.delattr(iplw, "frames")
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r"pip install 'iplw\[zmq\]'"):
        importlib.reload(zeromq)
    monkeypatch.undo()
    importlib.reload(zeromq)


def test_http_needs_neither_pyzmq_nor_msgpack() -> None:
    # Without pyzmq and msgpack, everything except tcp:// works.
    code = (
        "import sys\nsys.modules['zmq'] = sys.modules['msgpack'] = None\n"
        "import iplw\nwith iplw.Client() as client:\n    world = client.create_world('bowling')\n"
        "    world.reset(seed=1)\n    print(len(world.rollout([1, 2, 3], trajectories=True)))\n"
        "envs = iplw.make_vec('bowling', 2)\nenvs.reset(seed=1)\nenvs.step(envs.action_space.sample())\nenvs.close()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "3\n", done.stderr


READY = b"\x04\x19\x05READY\x0bSocket-Type\x00\x00\x00\x06ROUTER"
GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x01" + b"NULL".ljust(20, b"\0") + bytes(32)


@pytest.mark.parametrize(
    "message",
    [
        b"HTTP/1.1 400 Bad Request\r\n\r\n" + b" " * 64,
        GREETING.replace(b"NULL", b"CURV") + READY,
        GREETING + b"\x04\x09\x05ERROR\x02no",
        GREETING + b"\x00\x02hi",
        GREETING[:30],
        b"",
    ],
)
def test_rejects_other_zmtp_peers(message: bytes) -> None:
    def serve(connected: socket.socket, done: threading.Event) -> None:
        connected.sendall(message)
        done.wait(10)

    with peer(serve) as port:
        with pytest.raises(iplw.ServerUnavailable, match="no iplw server at tcp://"):
            iplw.Client(f"tcp://127.0.0.1:{port}", timeout=0.5).worlds()


def test_header_order_and_id_types() -> None:
    with iplw.Client("tcp://private") as client:
        dealer: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        dealer.linger = 0
        dealer.setsockopt(zmq.HEARTBEAT_IVL, 50)
        dealer.rcvtimeo = 10_000
        dealer.connect(client.url)
        time.sleep(0.3)
        header = {"args": {"id": "bowling-sim", "seed": 3}, "id": b"mine", "op": "reset_world", "v": 1, "raw": True}
        dealer.send_multipart([msgpack.packb(header)])
        head, observation = dealer.recv_multipart()
        message = msgpack.unpackb(head)
        dealer.close()
        expected, info = client.world("bowling-sim").reset(seed=3)
        # The same episode but for its number.
        answered = {**message["result"]["info"], "episode": info["episode"]}
        assert (message["id"], message["ok"], answered) == (b"mine", True, info)
        assert observation == expected.tobytes()


def test_broken_connection_is_not_reused() -> None:
    # Sockets are closed and their file descriptors reused.
    for _ in range(8):
        with router(lambda header: ok(header, {"worlds": []})) as (url, _):
            client = iplw.Client(url, timeout=5)
            assert client.worlds() == client.worlds() == []
        start = time.monotonic()
        with pytest.raises(iplw.ServerUnavailable, match="no iplw server"):
            client.worlds()
        assert time.monotonic() - start < 4
        client.close()
