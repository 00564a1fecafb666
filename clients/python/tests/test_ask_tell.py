"""Ask and tell."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stub import reply, serving

import iplw


def start(client: iplw.Client, **extra: Any) -> iplw.AskTellJob:
    small: dict[str, Any] = {"rounds": 2, "actions": 3, "samples": 16, "seed": 2, **extra}
    return client.iplw("basketball", real="ask_tell", **small)


def measure(world: iplw.World, proposal: iplw.Proposal) -> tuple[Any, dict[str, Any]]:
    """A measurement in the server's real world, without the angle."""
    result = world.rollout([proposal.action], task=proposal.task, trajectories=True)[0]
    assert result.t is not None
    return result.t, {name: states[:, :2] for name, states in result.bodies.items()}


def test_proposals_give_reasons(client: iplw.Client) -> None:
    job = start(client, strategy="probing", rounds=1, actions=2)
    reasons = [proposal.reason for proposal in job.proposals()]
    assert len(reasons) == 2 and all(reason and "collisions" in reason for reason in reasons)
    job.cancel()
    plain = start(client, rounds=1, actions=1)
    assert [proposal.reason for proposal in plain.proposals()] == [None]
    plain.cancel()


def test_ask_tell_until_result(client: iplw.Client, tmp_path: Path) -> None:
    job = start(client)
    assert isinstance(job, iplw.AskTellJob) and isinstance(client.job(job.id), iplw.AskTellJob)
    with client.create_world("basketball", kind="real") as world:
        first = job.proposals()
        assert [p.number for p in first] == [0, 1, 2] and job.state == "waiting"
        proposal = first[0]
        assert proposal.scene["format"] == "iplw.scene/1" and proposal.observe_at[0] == 0.0
        t, bodies = measure(world, proposal)
        response = job.tell(proposal, t, bodies)
        assert response == {"round": 0, "answered": 1, "failed": 0, "open": 2, "state": "waiting"}
        assert job.tell(proposal.number, t, bodies) == response, "submitting is idempotent"
        with pytest.raises(iplw.Problem, match="replace") as caught:
            job.tell(proposal, t, {name: states + 1.0 for name, states in bodies.items()})
        assert caught.value.status == 409
        displaced = {name: {"x": s[:, 0] + 1.0, "y": s[:, 1]} for name, s in bodies.items()}
        assert job.tell(proposal, t, displaced, replace=True) == response
        job.tell(proposal, t, bodies, replace=True)
        assert [p.number for p in job.proposals()] == [1, 2]
        assert [p.answered for p in job.proposals(all=True)] == [True, False, False]
        job.fail([first[1]])
        assert job.close(0)["state"] == "queued"
        second = job.proposals(timeout=60)
        assert [(p.number, p.round) for p in second] == [(3, 1), (4, 1), (5, 1)]
        lines = ["trial,t,body,x,y"]
        for p in second[:2]:
            t, bodies = measure(world, p)
            for i, at in enumerate(t):
                lines += [f"{p.number},{at},{name},{s[i, 0]},{s[i, 1]}" for name, s in bodies.items()]
        assert job.tell_csv("\n".join(lines) + "\n", failed=[5])["failed"] == 1
    assert job.proposals() == []
    result = job.wait()
    assert result["real_interactions"] == 3
    assert [trial["proposal"] for trial in job.trials()] == [0, 3, 4]
    job.save_trials(tmp_path)
    assert (tmp_path / "trials.csv").read_text().startswith("trial,setting,t,body,x,y")
    assert len(json.loads((tmp_path / "scene.json").read_text())["settings"]) == 3


#: A ball that is thrown over a table; nothing is to be solved.
RIG: dict[str, Any] = {
    "format": "iplw.scene/1",
    "name": "table",
    "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.05}, "position": [0.0, 0.5]}],
    "statics": [{"name": "table", "shape": {"type": "segment", "from": [-1, 0], "to": [6, 0]}}],
    "time_step": 0.004,
    "steps": 250,
    "observe_every": 5,
    "calibrate": ["friction", "restitution"],
    "action": {
        "components": [
            {"target": "ball", "set": "vx", "low": 0, "high": 4},
            {"target": "ball", "set": "vy", "low": -1, "high": 3},
        ]
    },
}


def test_rig_without_a_task(client: iplw.Client) -> None:
    """A scene with an action space is enough to estimate, to see a bad fit, and to diagnose it."""
    hidden = {"latents": {"friction": 0.3, "restitution": 0.7}, "noise": 0.002}
    arguments: dict[str, Any] = {"strategy": "informative", "residual": "shooting", "rounds": 2, "actions": 6}
    good = client.iplw(scene=RIG, real=hidden, **arguments).wait()
    assert isinstance(good, iplw.Estimate)
    assert not good.bad_fit and abs(good.known["restitution"] - 0.7) < 0.1
    job = client.iplw(scene=RIG, real={**hidden, "damping": 0.6}, **arguments)
    bad = job.wait()
    assert isinstance(bad, iplw.Estimate) and bad.bad_fit
    found = client.diagnose(job=job).wait()
    assert isinstance(found, iplw.Diagnosis) and found.verdict == "named"
    effect = found.physics["effects"][0]
    assert effect["name"] == "linear_drag" and abs(effect["parameters"]["c"] - 0.511) < 0.02, "-ln 0.6"


def test_a_rig_needs_an_action_space_and_no_task(client: iplw.Client) -> None:
    bodies: list[dict[str, Any]] = [
        {},
        {"task": "bowling", "scene": RIG},
        {"scene": RIG, "strategy": "gradient"},
        {"scene": RIG, "prior": {"grip": [1.0, 1.0]}},
        {"scene": {**RIG, "action": None}},
    ]
    for body in bodies:
        with pytest.raises(iplw.Problem) as caught:
            client.iplw(**body)
        assert caught.value.status == 422, body


def test_rejects_invalid_results(client: iplw.Client) -> None:
    job = start(client)
    proposal = job.proposals()[0]
    with pytest.raises(ValueError, match=r"\(n, 2\)"):
        job.tell(proposal, [0.0], {"ball": [1.0, 2.0]})
    with pytest.raises(iplw.Problem) as caught:
        job.tell(proposal, [0.0], {"bal": [[1.0, 2.0]]})
    assert caught.value.field == "trials[0].bodies.bal" and "ball" in str(caught.value)
    observed = [[1.0, 2.0], [np.nan, np.nan]]
    assert job.tell(proposal, [0.0, 0.1], {"ball": observed})["answered"] == 1, "NaN is a missing value"
    job.cancel()
    with pytest.raises(iplw.JobCancelled):
        job.wait()
    assert job.proposals() == []


def test_job_without_proposals(client: iplw.Client) -> None:
    job = client.iplw("basketball", rounds=1, actions=2, samples=8)
    assert not isinstance(job, iplw.AskTellJob)
    job.wait()
    assert job.eta is None


def test_request_with_key_is_retried(client: iplw.Client) -> None:
    first = client.create_world("basketball", key="test-a-key")
    with client.create_world("basketball", key="test-a-key") as again:
        assert again.id == first.id
    fetch = reply("201 Created", '{"id": "w", "kind": "sim"}')
    with serving(lambda n, method, path: None if n == 0 else fetch) as stub:
        assert iplw.Client(stub.url).create_world("bowling", key="k").id == "w"
        assert [method for method, *_ in stub.requests] == ["POST", "POST"], "retried after a lost connection"


def test_reads_all_pages_of_a_list() -> None:
    def answer(n: int, method: str, path: str) -> bytes:
        world = {"id": f"w{n}", "kind": "sim"}
        return reply("200 OK", json.dumps({"worlds": [world], "next": "abc" if n == 0 else None}))

    with serving(answer) as stub:
        assert [w.id for w in iplw.Client(stub.url).worlds()] == ["w0", "w1"]
        assert [path for _, path, _ in stub.requests] == [
            "/v1/worlds?limit=1000",
            "/v1/worlds?limit=1000&cursor=abc",
        ]
