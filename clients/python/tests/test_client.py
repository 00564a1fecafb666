"""The client: arrays, problems, timeouts, jobs."""

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
from iplw.http import parse_events


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


def test_budget_is_enforced(client: iplw.Client) -> None:
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
        (lambda c: c.plan("bowling:000", latents={}, posterior={}), 422, ["latents", "posterior"]),
        (lambda c: c.train("bowling", training="fixed", posterior={}), 422, ["training", "posterior"]),
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
def test_problems_name_the_invalid_value(client: iplw.Client, call: Any, status: int, words: list[str]) -> None:
    with pytest.raises(iplw.Problem) as caught:
        call(client)
    problem = caught.value
    assert problem.status == status
    assert str(problem).startswith(str(status)) and all(word in str(problem) for word in words), str(problem)
    copy = pickle.loads(pickle.dumps(problem))
    assert str(copy) == str(problem) and copy.field == problem.field


@pytest.mark.parametrize("action", [[0.5, float("nan"), 0.5], [[0.5] * 3], "left", True, 1.5])
def test_rejects_invalid_actions_locally(client: iplw.Client, action: Any) -> None:
    with pytest.raises(ValueError, match="allowed: "):
        client.world("bowling-sim").step(action)


def test_unreachable_server() -> None:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        client = iplw.Client(f"http://127.0.0.1:{held.getsockname()[1]}")
        with pytest.raises(iplw.ServerUnavailable, match=r"no iplw server at .*iplw serve"):
            client.worlds()


def test_silent_server_times_out() -> None:
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        client = iplw.Client(f"127.0.0.1:{deaf.getsockname()[1]}", timeout=0.2)
        with pytest.raises(iplw.ServerUnavailable, match=r"within 0.2 s; increase"):
            client.create_world("bowling")


@pytest.mark.parametrize("url", ["tcp://127.0.0.1", "http://", "ftp://x"])
def test_rejects_malformed_addresses(url: str) -> None:
    with pytest.raises(ValueError, match="allowed: an address like"):
        iplw.Client(url)


def test_closed_client_raises() -> None:
    client = iplw.Client("http://127.0.0.1:1")
    client.close()
    client.close()
    with pytest.raises(iplw.ServerUnavailable, match="closed"):
        client.worlds()


def test_retries_only_idempotent_requests() -> None:
    with serving(lambda n, method, path: None) as stub:
        client = iplw.Client(stub.url)
        with pytest.raises(iplw.ServerUnavailable, match="may or may not have been executed"):
            client.create_world("bowling")
        assert [method for method, *_ in stub.requests] == ["POST"]
    with serving(lambda n, method, path: None if n == 0 else reply("200 OK", '{"worlds": []}')) as stub:
        assert iplw.Client(stub.url).worlds() == []
        assert [method for method, *_ in stub.requests] == ["GET", "GET"]


def test_invalid_responses() -> None:
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
    with pytest.raises(TimeoutError, match="it continues"):
        job.wait(timeout=0.0)
    with pytest.raises(RuntimeError, match="wait"):
        job.result()
    job.cancel()
    with pytest.raises(iplw.JobCancelled):
        job.wait(timeout=60)
    job.cancel()
    assert client.job(job.id).state == "cancelled", "cancelling an ended job does not delete it"
    assert client.job(job.id).summary is None


def test_names_and_notes_of_jobs(client: iplw.Client) -> None:
    job = client.iplw("bowling", rounds=1, actions=2, samples=8)
    assert (job.name, job.note) == ("", "")
    job.rename("Bowling on felt")
    job.annotate("Camera 2,\nlights on.")
    job.wait()
    assert job.summary
    same = client.job(job.id)
    assert (same.name, same.note, same.summary) == ("Bowling on felt", "Camera 2,\nlights on.", job.summary)
    assert "Bowling on felt (iplw job-" in same._repr_html_()
    with pytest.raises(iplw.Problem, match="name"):
        job.rename("n" * 201)
    job.rename("")
    assert (job.name, job.note) == ("", "Camera 2,\nlights on.")


def test_policy(client: iplw.Client, tmp_path: Any) -> None:
    # Only the easiest task, to save time.
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


def test_wait_resumes_event_stream() -> None:
    def answer(n: int, method: str, path: str) -> bytes:
        if not path.endswith("/events"):
            return reply("200 OK", job("running"))
        state = "succeeded" if n > 2 else "running"
        return reply("200 OK", f"event: progress\nid: {n}\ndata: {job(state)}\n\n", "text/event-stream")

    with serving(answer) as stub:
        assert iplw.Client(stub.url).job("j").wait() == {"x": 1}
        assert [last for _, path, last in stub.requests if path.endswith("/events")] == [None, "1"]


def test_wait_polls_without_events() -> None:
    def answer(n: int, method: str, path: str) -> bytes:
        if path.endswith("/events"):
            return reply("404 Not Found", "{}")
        return reply("200 OK", job("succeeded" if n > 4 else "running"))

    with serving(answer) as stub:
        assert iplw.Client(stub.url).job("j").wait(progress=True) == {"x": 1}


def test_wait_times_out_on_silent_stream() -> None:
    def answer(n: int, method: str, path: str) -> bytes:
        if path.endswith("/events"):
            # Headers of an event stream, then silence.
            return b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nContent-Length: 99\r\n\r\n"
        return reply("200 OK", job("running"))

    with serving(answer, hold=True) as stub:
        with pytest.raises(TimeoutError, match="job j has not ended within the timeout"):
            iplw.Client(stub.url, timeout=60).job("j").wait(timeout=0.1)


def test_failed_job_reports_problem() -> None:
    failed = {"id": "j", "kind": "train", "state": "failed", "error": {"detail": "loss is not finite"}}
    with serving(lambda n, method, path: reply("200 OK", json.dumps(failed))) as stub:
        with pytest.raises(iplw.JobFailed, match="job j failed: .*loss is not finite"):
            iplw.Client(stub.url).job("j").wait()


def test_parses_event_stream_split_anywhere() -> None:
    stream = (
        ": hello\r\n\r\nevent: done\r\nid: 7\r\ndata: {\r\ndata: }\r\n\r\n\r\nretry: 5\n\ndata:ü\n\n".encode()
    )
    full = list(parse_events(iter([stream])))
    assert [(e.name, e.id, e.data) for e in full] == [("done", "7", "{\n}"), ("message", "7", "ü")]
    assert list(parse_events(stream[i : i + 1] for i in range(len(stream)))) == full


def test_surface_and_diagnosis(client: iplw.Client, tmp_path: Path) -> None:
    with client.create_world("basketball", kind="real") as world:
        chance = client.policy("random").evaluate(world, attempts=2).wait()
        assert 0.0 <= chance["auccess"] <= 1.0
        learned = client.policy("untrained").learn(world, attempts=200, batches=4, seed=1).wait()
        assert learned["interactions"] == 200
        assert world.refresh().interactions == 200 + chance["interactions"]
        assert client.policy(learned["policy"]).data["training"] == "direct"
    outcome = client.find_surface("basketball", points=3, actions=100).wait()
    assert outcome["surface"] and {row["factor"] for row in outcome["sensitivities"]} == {"friction", "restitution"}
    run = client.iplw("basketball", rounds=1, actions=4, samples=12)
    run.wait()
    diagnosis = client.diagnose(job=run).wait()
    assert diagnosis["format"] == "iplw.diagnosis/2"
    run.save_trials(tmp_path)
    scene = json.loads((tmp_path / "scene.json").read_text())
    again = client.diagnose(scene, (tmp_path / "trials.csv").read_text()).wait()
    assert again["verdict"] == diagnosis["verdict"]


def test_samples_posterior(client: iplw.Client) -> None:
    noise = np.random.default_rng(5)
    c, t = 0.3, np.linspace(0.0, 0.9, 24)
    has_ended = (1 - np.exp(-c * t)) / c

    def throw(vx: float, vy: float) -> Any:
        x, y = vx * has_ended, (vy + 9.81 / c) * has_ended - 9.81 * t / c
        return np.stack([t, x, y], axis=1) + noise.normal(0, 1e-3, (24, 3)) * [0, 1, 1]

    throws = [throw(3 + 0.5 * k, 4 - 0.3 * k) for k in range(8)]
    sets = [["linear_drag"], ["wind"]]
    identified = client.posterior(ball={"radius": 0.02}, trials=throws, sets=sets, draws=64, seed=1).wait()
    assert identified["format"] == "iplw.posterior/2" and identified["sets"][0]["weight"] > 0.9
    sampled = np.array([v for v in identified["columns"]["linear_drag.c"] if v is not None])
    assert abs(sampled.mean() - c) < 5 * sampled.std() and 0 < sampled.std() < 0.05
    plan = client.plan("basketball:003", posterior=identified, actions=50, draws=4, exact=2, seed=1).wait()
    assert plan["posterior"]["source"] == "posterior"


def test_trains_policy_on_posterior(client: iplw.Client) -> None:
    posterior = {"format": "iplw.posterior/2", "columns": {"friction": [0.2, 0.25], "linear_drag.c": [0.22, None]}}
    result = client.train("basketball", posterior=posterior, batches=4, batch_size=8, seed=1).wait()
    assert result["training"] == {"type": "believed", "draws": 2}
    assert client.policy(result["policy"]).data["training"] == "believed"


def test_plans_task(client: iplw.Client) -> None:
    posterior = {"format": "iplw.posterior/2", "columns": {"friction": [0.2, 0.25], "linear_drag.c": [0.22, None]}}
    plan = client.plan("basketball:003", posterior=posterior, actions=100, draws=4, exact=2, seed=1).wait()
    assert plan["format"] == "iplw.plan/1" and plan["posterior"] == {"source": "posterior", "draws": 2}
    assert plan["complete"] and all(0 <= row["probability"] <= 1 for row in plan["actions"][:2])
    identified = client.plan("basketball:003", latents={"friction": 0.2}, actions=100, draws=4, rollouts=10).wait()
    assert identified["posterior"]["source"] == "point" and not identified["complete"]


def test_designs_experiments(client: iplw.Client) -> None:
    small: dict[str, Any] = {"candidates": 16, "shortlist": 4, "worlds": 16, "copies": 2, "seed": 2}
    outcome = client.design("basketball", question="effects", sets=[[], ["linear_drag"]], batch=2, **small).wait()
    assert outcome["format"] == "iplw.design/1" and len(outcome["experiments"]) == 2
    first = outcome["experiments"][0]
    assert len(first["action"]) == 4 and "linear_drag" in first["reason"]
    posterior = {"format": "iplw.posterior/2", "columns": {"friction": [0.2 + 0.01 * i for i in range(20)]}}
    response = client.design("basketball", posterior=posterior, **small).wait()["experiments"][0]["expected"]
    assert [number["name"] for number in response] == ["friction"]
    paid = client.design("basketball:003", costs={"setup": 2, "budget": 4}, **small).wait()
    assert [experiment["cost"] for experiment in paid["experiments"]] == [3, 1] and paid["cost"] == 4


def test_surface_lifecycle(client: iplw.Client, tmp_path: Path) -> None:
    id = client.find_surface("basketball", points=3, actions=100, seed=5).wait()["surface"]
    assert id in {surface.id for surface in client.surfaces()}
    surface = client.surface(id)
    assert surface.task == "basketball" and {row["factor"] for row in surface.sensitivities} == {"friction", "restitution"}
    assert surface.points()["format"] == "iplw.surface/1"
    sampled = surface.draw(tmp_path / "surface.svg")
    assert b"<svg" in sampled and (tmp_path / "surface.svg").read_bytes() == sampled
    surface.delete()
    assert id not in {surface.id for surface in client.surfaces()}


def test_calls_any_operation(client: iplw.Client) -> None:
    assert client.call("get_world", id="bowling-sim")["id"] == "bowling-sim"
    assert client.call("list_tasks", family="bowling", limit=2)["next"]
    assert client.call("render_world", id="bowling-sim", task="bowling:000", width=64).startswith(b"\x89PNG")
    assert b"iplw" in client.call("metrics")
    created = [client.call("create_world", task="bowling", key="test-any")["id"] for _ in range(2)]
    assert created[0] == created[1] and client.call("delete_world", id=created[0]) is None
    job = client.start("start_iplw", task="basketball", rounds=1, actions=2, samples=8)
    assert job.wait()["real_interactions"] > 0
    for call, message in [
        (lambda: client.call("get_word"), "operation is 'get_word'; allowed: .*get_world"),
        (lambda: client.call("get_world", id="w", limit=3), r"get_world does not accept \['limit'\]; allowed: id"),
        (lambda: client.call("get_world"), "get_world needs id"),
        (lambda: client.call("get_world", id="w", key="k"), "get_world does not accept a key"),
        (lambda: client.start("get_world", id="w"), "get_world does not start a job; allowed: .*start_iplw"),
    ]:
        with pytest.raises(ValueError, match=message):
            call()  # type: ignore[no-untyped-call]


def test_follows_job(client: iplw.Client) -> None:
    job = client.iplw("basketball", rounds=2, actions=3, samples=32, seed=3)
    states = [data["state"] for data in job.follow()]
    assert states and states[-1] == job.state == "succeeded" and "succeeded" not in states[:-1]
    assert not list(job.follow())


def test_rejects_header_injection() -> None:
    with serving(lambda n, method, path: reply("200 OK", "{}")) as stub:
        client = iplw.Client(stub.url)
        with pytest.raises(ValueError):
            client.create_world("bowling", key="a\r\nX: 1")
        assert not stub.requests


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
def test_truncated_response_is_an_error(raw: bytes) -> None:
    with serving(lambda n, method, path: raw) as stub:
        with pytest.raises(iplw.ServerUnavailable):
            iplw.Client(stub.url, timeout=5).create_world("bowling")


def test_uses_proxy_from_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    with serving(lambda n, method, path: reply("200 OK", '{"worlds": []}')) as stub:
        monkeypatch.setenv("HTTP_PROXY", stub.url)
        monkeypatch.setenv("http_proxy", stub.url)
        assert iplw.Client("http://iplw.invalid/behind").worlds() == []
        assert [path for _, path, _ in stub.requests] == ["http://iplw.invalid/behind/v1/worlds?limit=1000"]
    with serving(lambda n, method, path: reply("200 OK", '{"worlds": []}')) as stub:
        # No proxy for servers on this machine; the proxy above has stopped.
        assert iplw.Client(stub.url).worlds() == []
