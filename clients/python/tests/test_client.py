"""The client: answers as arrays, refusals as problems, silence as advice, jobs."""

from __future__ import annotations

import json
import pickle
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stub import reply, serving

import iplw
from iplw.http import parse


def test_rollouts_are_arrays(client: iplw.Client) -> None:
    with client.create_world("bowling:002") as world:
        observation, info = world.reset()
        names = world.data["observation_space"]["names"]
        assert info["task"] == "bowling:002" and observation.shape == (len(names),)
        results = world.rollout(range(40), trajectories=True, batch=16)
        assert len(results) == 40 and results.valid.dtype == np.bool_
        assert not results.solved[~results.valid].any()
        for result in results:
            assert (result.reason is None) == result.valid
            if result.valid:
                assert result.t is not None and (np.diff(result.t) > 0).all()
                assert set(result.bodies) == {"green", "blue", "red"}
                assert all(path.shape == (len(result.t), 3) for path in result.bodies.values())
        assert world.interactions == int(results.valid.sum())
        assert isinstance(results[:3], iplw.Rollouts) and len(results[:3]) == 3


def test_rollouts_as_data_frames(client: iplw.Client) -> None:
    pandas = pytest.importorskip("pandas")
    with client.create_world("bowling:002") as world:
        results = world.rollout(range(10), task="bowling:002", trajectories=True)
        result = results[int(results.valid.argmax())]
        frame = result.frame()
        assert isinstance(frame, pandas.DataFrame) and result.t is not None
        assert list(frame.columns) == ["t", "body", "x", "y", "angle"] and len(frame) == 3 * len(result.t)
        with pytest.raises(ValueError, match="trajectories=True"):
            world.rollout([0], task="bowling:002")[0].frame()


def test_tasks(client: iplw.Client) -> None:
    assert {family["name"] for family in client.tasks()} >= {"bowling", "basketball"}
    assert len(client.task_ids("bowling")) == 100 and len(client.task_ids("bowling", "test")) == 20
    task = client.task("bowling:017")
    assert task["id"] == "bowling:017" and task["scene"]["format"] == "iplw.scene/1"


def test_budgets_are_kept(client: iplw.Client) -> None:
    with client.create_world("bowling:002", kind="real", budget=3) as world:
        world.reset()
        with pytest.raises(iplw.Problem) as caught:
            world.rollout(range(64))
        assert (caught.value.status, caught.value.slug) == (429, "budget-spent")


@pytest.mark.parametrize(
    ("call", "status", "words"),
    [
        (lambda c: c.world("nowhere"), 404, ["nowhere"]),
        (lambda c: c.world("../v1/tasks"), 404, []),
        (lambda c: c.policy("untrained").learn("nowhere"), 404, []),
        (lambda c: c.find_surface("bowlign"), 404, ["bowlign"]),
        (lambda c: c.diagnose(job="nowhere"), 404, ["nowhere"]),
        (lambda c: c.posterior(job="nowhere"), 404, ["nowhere"]),
        (lambda c: c.posterior(ball={"radius": 0.02}, trials="t,x,y\n0,0,0\n", draws=1), 422, ["draws"]),
        (lambda c: c.plan("bowling:999"), 404, ["bowling:999"]),
        (lambda c: c.design("bowling", sets=[["sticky_patch"]]), 422, ["sticky_patch"]),
        (lambda c: c.plan("bowling:000", latents={}, belief={}), 422, ["latents", "belief"]),
        (lambda c: c.train("bowling", training="fixed", belief={}), 422, ["training", "belief"]),
        (lambda c: c.train("bowling:000", preset="saturating"), 422, ["task", "bowling:000"]),
        (lambda c: c.create_world("bowlign"), 404, ["bowlign", "bowling"]),
        (lambda c: c.create_world("bowling", latents={"friction": -1}), 422, ["friction", "-1"]),
        (lambda c: c.create_world("bowling", latents={"colour": 1}), 400, ["colour"]),
        (lambda c: c.world("bowling-real").set_latents(friction=0.1), 403, []),
        (lambda c: c.world("bowling-sim").rollout([[0.5, 0.5]], task="bowling:000"), 422, ["action", "3"]),
        (
            lambda c: c.world("bowling-sim").rollout([[0.5, 2.0, 0.5]], task="bowling:000"),
            422,
            ["action", "2"],
        ),
        (lambda c: c.world("bowling-sim").rollout([50_000], task="bowling:000"), 422, ["50000", "49999"]),
    ],
)
def test_refusals_say_what_is_wrong(client: iplw.Client, call: Any, status: int, words: list[str]) -> None:
    with pytest.raises(iplw.Problem) as caught:
        call(client)
    problem = caught.value
    assert problem.status == status
    assert str(problem).startswith(str(status)) and all(word in str(problem) for word in words), str(problem)
    copy = pickle.loads(pickle.dumps(problem))
    assert str(copy) == str(problem) and copy.field == problem.field


@pytest.mark.parametrize("action", [[0.5, float("nan"), 0.5], [[0.5] * 3], "left", True, 1.5])
def test_senseless_actions_stay_here(client: iplw.Client, action: Any) -> None:
    with pytest.raises(ValueError, match="allowed: "):
        client.world("bowling-sim").step(action)


def test_nobody_there() -> None:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        client = iplw.Client(f"http://127.0.0.1:{held.getsockname()[1]}")
        with pytest.raises(iplw.ServerUnavailable, match=r"no iplw server at .*iplw serve"):
            client.worlds()


def test_silence_ends_with_the_timeout() -> None:
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        client = iplw.Client(f"127.0.0.1:{deaf.getsockname()[1]}", timeout=0.2)
        with pytest.raises(iplw.ServerUnavailable, match=r"within 0.2 s; give it longer"):
            client.create_world("bowling")


@pytest.mark.parametrize("url", ["tcp://127.0.0.1", "http://", "ftp://x"])
def test_addresses_are_checked(url: str) -> None:
    with pytest.raises(ValueError, match="allowed: an address like"):
        iplw.Client(url)


def test_a_closed_client_says_so() -> None:
    client = iplw.Client("http://127.0.0.1:1")
    client.close()
    client.close()
    with pytest.raises(iplw.ServerUnavailable, match="closed"):
        client.worlds()


def test_only_what_is_harmless_is_repeated() -> None:
    with serving(lambda n, method, path: None) as stub:
        client = iplw.Client(stub.url)
        with pytest.raises(iplw.ServerUnavailable, match="may or may not have happened"):
            client.create_world("bowling")
        assert [method for method, *_ in stub.seen] == ["POST"]
    with serving(lambda n, method, path: None if n == 0 else reply("200 OK", '{"worlds": []}')) as stub:
        assert iplw.Client(stub.url).worlds() == []
        assert [method for method, *_ in stub.seen] == ["GET", "GET"]


def test_strange_answers() -> None:
    with serving(lambda n, method, path: reply("200 OK", "<html>", "text/html")) as stub:
        with pytest.raises(iplw.ServerUnavailable, match="is it an iplw server"):
            iplw.Client(stub.url).worlds()
    with serving(lambda n, method, path: reply("500 Oops", "it broke", "text/plain")) as stub:
        with pytest.raises(iplw.Problem, match="500 Oops: it broke"):
            iplw.Client(stub.url).worlds()


def test_iplw_job(client: iplw.Client, capsys: pytest.CaptureFixture[str]) -> None:
    with client.create_world("bowling", kind="real") as real:
        job = client.iplw("bowling", world=real, rounds=1, actions=3, samples=20, seed=1)
        assert job.kind == "iplw"
        result = job.wait(progress=True)
        assert {"density", "friction", "restitution"} == {row["name"] for row in result["latents"]}
        assert real.interactions == result["real_interactions"] > 0
    assert job.state == "succeeded" and client.job(job.id).wait() == result
    assert capsys.readouterr().err.startswith("iplw: ")


def test_cancel(client: iplw.Client) -> None:
    job = client.iplw("bowling", real={"damping": 0.8}, rounds=10, actions=50, samples=1000)
    with pytest.raises(TimeoutError, match="goes on"):
        job.wait(timeout=0.0)
    with pytest.raises(RuntimeError, match="wait"):
        job.result()
    job.cancel()
    with pytest.raises(iplw.JobCancelled):
        job.wait(timeout=60)
    job.cancel()
    assert client.job(job.id).state == "cancelled", "cancelling what has ended does not forget it"


def test_policy(client: iplw.Client, tmp_path: Any) -> None:
    # One task, the easiest, since every task's rollouts cost time.
    tasks = client.family("bowling")["tasks"]
    easiest = max(tasks, key=lambda task: float(task["certificate"]["solving_share_undamped"]))
    result = client.train(easiest["id"], batches=5, batch_size=8, seed=1).wait()
    policy = client.policy(result["policy"])
    best = policy.act("bowling:001", 5)
    assert len(best) == 5 and best[0].action.shape == (3,)
    assert [r.score for r in best] == sorted((r.score for r in best), reverse=True)
    weights = policy.download(tmp_path / "policy.safetensors")
    copy = client.upload_policy("copy", tmp_path / "policy.safetensors")
    assert copy.download() == weights
    assert [r.index for r in copy.act("bowling:001", 5)] == [r.index for r in best]
    with client.create_world("bowling", kind="real") as real:
        score = policy.evaluate(real, attempts=2).wait()
        assert 0.0 <= score["auccess"] <= 1.0 and real.interactions == score["interactions"]
    with pytest.raises(iplw.Problem) as caught:
        client.upload_policy("bad", b"not weights")
    assert caught.value.status == 422
    copy.delete()
    assert "copy" not in {p.id for p in client.policies()}


def job(state: str, done: int = 0) -> str:
    progress = {"stage": "measuring", "done": done, "total": 3}
    return json.dumps({"id": "j", "kind": "iplw", "state": state, "progress": progress, "result": {"x": 1}})


def test_waiting_goes_on_where_the_events_broke_off() -> None:
    def answer(n: int, method: str, path: str) -> bytes:
        if not path.endswith("/events"):
            return reply("200 OK", job("running"))
        state = "succeeded" if n > 2 else "running"
        return reply("200 OK", f"event: progress\nid: {n}\ndata: {job(state)}\n\n", "text/event-stream")

    with serving(answer) as stub:
        assert iplw.Client(stub.url).job("j").wait() == {"x": 1}
        assert [last for _, path, last in stub.seen if path.endswith("/events")] == [None, "1"]


def test_waiting_without_events_looks() -> None:
    def answer(n: int, method: str, path: str) -> bytes:
        if path.endswith("/events"):
            return reply("404 Not Found", "{}")
        return reply("200 OK", job("succeeded" if n > 4 else "running"))

    with serving(answer) as stub:
        assert iplw.Client(stub.url).job("j").wait(progress=True) == {"x": 1}


def test_waiting_ends_in_time_though_nothing_comes() -> None:
    def answer(n: int, method: str, path: str) -> bytes:
        if path.endswith("/events"):
            # Headers that promise events, then silence while the client holds on.
            return b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nContent-Length: 99\r\n\r\n"
        return reply("200 OK", job("running"))

    with serving(answer, hold=True) as stub:
        with pytest.raises(TimeoutError, match="job j has not ended in time"):
            iplw.Client(stub.url, timeout=60).job("j").wait(timeout=0.1)


def test_failed_jobs_say_why() -> None:
    failed = {"id": "j", "kind": "train", "state": "failed", "error": {"detail": "loss is not finite"}}
    with serving(lambda n, method, path: reply("200 OK", json.dumps(failed))) as stub:
        with pytest.raises(iplw.JobFailed, match="job j failed: .*loss is not finite"):
            iplw.Client(stub.url).job("j").wait()


def test_event_streams_may_be_cut_anywhere() -> None:
    stream = (
        ": hello\r\n\r\nevent: done\r\nid: 7\r\ndata: {\r\ndata: }\r\n\r\n\r\nretry: 5\n\ndata:ü\n\n".encode()
    )
    whole = list(parse(iter([stream])))
    assert [(e.name, e.id, e.data) for e in whole] == [("done", "7", "{\n}"), ("message", "7", "ü")]
    assert list(parse(stream[i : i + 1] for i in range(len(stream)))) == whole


def test_baselines_and_what_the_simulation_lacks(client: iplw.Client, tmp_path: Path) -> None:
    with client.create_world("basketball", kind="real") as world:
        chance = client.policy("random").evaluate(world, attempts=2).wait()
        assert 0.0 <= chance["auccess"] <= 1.0
        learned = client.policy("untrained").learn(world, attempts=200, batches=4, seed=1).wait()
        assert learned["interactions"] == 200
        assert world.refresh().interactions == 200 + chance["interactions"]
        assert client.policy(learned["policy"]).data["training"] == "direct"
    found = client.find_surface("basketball", points=3, actions=100).wait()
    assert found["surface"] and {row["factor"] for row in found["sensitivities"]} == {"friction", "restitution"}
    run = client.iplw("basketball", rounds=1, actions=4, samples=12)
    run.wait()
    diagnosis = client.diagnose(job=run).wait()
    assert diagnosis["format"] == "iplw.diagnosis/1"
    run.save_trials(tmp_path)
    scene = json.loads((tmp_path / "scene.json").read_text())
    again = client.diagnose(scene, (tmp_path / "trials.csv").read_text()).wait()
    assert again["verdict"] == diagnosis["verdict"]


def test_what_is_known_is_drawn(client: iplw.Client) -> None:
    noise = np.random.default_rng(5)
    c, t = 0.3, np.linspace(0.0, 0.9, 24)
    gone = (1 - np.exp(-c * t)) / c

    def throw(vx: float, vy: float) -> Any:
        x, y = vx * gone, (vy + 9.81 / c) * gone - 9.81 * t / c
        return np.stack([t, x, y], axis=1) + noise.normal(0, 1e-3, (24, 3)) * [0, 1, 1]

    throws = [throw(3 + 0.5 * k, 4 - 0.3 * k) for k in range(8)]
    sets = [["linear_drag"], ["wind"]]
    known = client.posterior(ball={"radius": 0.02}, trials=throws, sets=sets, draws=64, seed=1).wait()
    assert known["format"] == "iplw.posterior/1" and known["sets"][0]["weight"] > 0.9
    drawn = np.array([v for v in known["columns"]["linear_drag.c"] if v is not None])
    assert abs(drawn.mean() - c) < 5 * drawn.std() and 0 < drawn.std() < 0.05
    plan = client.plan("basketball:003", belief=known, actions=50, draws=4, exact=2, seed=1).wait()
    assert plan["belief"]["source"] == "posterior"


def test_a_policy_is_trained_under_what_is_known(client: iplw.Client) -> None:
    belief = {"format": "iplw.posterior/1", "columns": {"friction": [0.2, 0.25], "linear_drag.c": [0.22, None]}}
    result = client.train("basketball", belief=belief, batches=4, batch_size=8, seed=1).wait()
    assert result["training"] == {"type": "believed", "draws": 2}
    assert client.policy(result["policy"]).data["training"] == "believed"


def test_tasks_are_planned(client: iplw.Client) -> None:
    belief = {"format": "iplw.posterior/1", "columns": {"friction": [0.2, 0.25], "linear_drag.c": [0.22, None]}}
    plan = client.plan("basketball:003", belief=belief, actions=100, draws=4, exact=2, seed=1).wait()
    assert plan["format"] == "iplw.plan/1" and plan["belief"] == {"source": "posterior", "draws": 2}
    assert plan["complete"] and all(0 <= row["probability"] <= 1 for row in plan["actions"][:2])
    known = client.plan("basketball:003", latents={"friction": 0.2}, actions=100, draws=4, rollouts=10).wait()
    assert known["belief"]["source"] == "point" and not known["complete"]


def test_experiments_are_designed(client: iplw.Client) -> None:
    small: dict[str, Any] = {"candidates": 16, "shortlist": 4, "worlds": 16, "copies": 2, "seed": 2}
    found = client.design("basketball", question="effects", sets=[[], ["linear_drag"]], batch=2, **small).wait()
    assert found["format"] == "iplw.design/1" and len(found["experiments"]) == 2
    first = found["experiments"][0]
    assert len(first["action"]) == 4 and "linear_drag" in first["reason"]
    belief = {"format": "iplw.posterior/1", "columns": {"friction": [0.2 + 0.01 * i for i in range(20)]}}
    told = client.design("basketball", belief=belief, **small).wait()["experiments"][0]["expected"]
    assert [number["name"] for number in told] == ["friction"]
    paid = client.design("basketball:003", costs={"setup": 2, "budget": 4}, **small).wait()
    assert [experiment["cost"] for experiment in paid["experiments"]] == [3, 1] and paid["cost"] == 4


def test_surfaces_are_listed_got_drawn_and_deleted(client: iplw.Client, tmp_path: Path) -> None:
    id = client.find_surface("basketball", points=3, actions=100, seed=5).wait()["surface"]
    assert id in {surface.id for surface in client.surfaces()}
    surface = client.surface(id)
    assert surface.task == "basketball" and {row["factor"] for row in surface.sensitivities} == {"friction", "restitution"}
    assert surface.points()["format"] == "iplw.surface/1"
    drawn = surface.draw(tmp_path / "surface.svg")
    assert b"<svg" in drawn and (tmp_path / "surface.svg").read_bytes() == drawn
    surface.delete()
    assert id not in {surface.id for surface in client.surfaces()}


def test_every_operation_can_be_called(client: iplw.Client) -> None:
    assert client.call("get_world", id="bowling-sim")["id"] == "bowling-sim"
    assert client.call("list_tasks", family="bowling", limit=2)["next"]
    assert client.call("render_world", id="bowling-sim", task="bowling:000", width=64).startswith(b"\x89PNG")
    assert b"iplw" in client.call("metrics")
    made = [client.call("create_world", task="bowling", key="test-any")["id"] for _ in range(2)]
    assert made[0] == made[1] and client.call("delete_world", id=made[0]) is None
    job = client.start("start_iplw", task="basketball", rounds=1, actions=2, samples=8)
    assert job.wait()["real_interactions"] > 0
    for ask, words in [
        (lambda: client.call("get_word"), "operation is 'get_word'; allowed: .*get_world"),
        (lambda: client.call("get_world", id="w", limit=3), r"get_world was given \['limit'\]; allowed: id"),
        (lambda: client.call("get_world"), "get_world needs id"),
        (lambda: client.call("get_world", id="w", key="k"), "get_world was given a key"),
        (lambda: client.start("get_world", id="w"), "get_world starts no job; allowed: .*start_iplw"),
    ]:
        with pytest.raises(ValueError, match=words):
            ask()  # type: ignore[no-untyped-call]


def test_a_job_is_followed(client: iplw.Client) -> None:
    job = client.iplw("basketball", rounds=2, actions=3, samples=32, seed=3)
    states = [data["state"] for data in job.follow()]
    assert states and states[-1] == job.state == "succeeded" and "succeeded" not in states[:-1]
    assert not list(job.follow())


def test_nothing_is_smuggled_into_headers() -> None:
    with serving(lambda n, method, path: reply("200 OK", "{}")) as stub:
        client = iplw.Client(stub.url)
        with pytest.raises(ValueError):
            client.create_world("bowling", key="a\r\nX: 1")
        assert not stub.seen


@pytest.mark.parametrize(
    "raw",
    [
        b"HTTP/1.1 200 OK\r\nContent-Le",
        b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\nabc",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n9\r\nabc",
        b"SSH-2.0-OpenSSH\r\n\r\n",
        b"x" * 200_000,
    ],
)
def test_an_answer_that_is_not_whole_is_none(raw: bytes) -> None:
    with serving(lambda n, method, path: raw) as stub:
        with pytest.raises(iplw.ServerUnavailable):
            iplw.Client(stub.url, timeout=5).create_world("bowling")


def test_a_proxy_is_the_environments(monkeypatch: pytest.MonkeyPatch) -> None:
    with serving(lambda n, method, path: reply("200 OK", '{"worlds": []}')) as stub:
        monkeypatch.setenv("HTTP_PROXY", stub.url)
        monkeypatch.setenv("http_proxy", stub.url)
        assert iplw.Client("http://iplw.invalid/behind").worlds() == []
        assert [path for _, path, _ in stub.seen] == ["http://iplw.invalid/behind/v1/worlds?limit=1000"]
    with serving(lambda n, method, path: reply("200 OK", '{"worlds": []}')) as stub:
        # Not for this machine's own servers, and the proxy above has gone.
        assert iplw.Client(stub.url).worlds() == []
