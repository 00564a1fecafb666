"""The numbers of a hidden real world appear in no answer of the server, and in nothing that the program prints or writes."""

from __future__ import annotations

import json
import math
import os
import random
import re
import struct
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

FAMILY = """
format = "iplw.family/1"
name = "drop"
about = "drop the ball onto the plate"
[candidates]
count = 12
[candidates.parameters]
middle = {{ low = -3, high = 3 }}
half = [0.6, 0.8, 3]
[scene]
time_step = "= 1 / 120"
steps = 150
observe_every = 30
calibrate = ["density", "friction", "restitution"]
bodies = [{{ name = "red", shape = {{ type = "disc", radius = 0.2 }}, density = {density}, friction = {friction}, restitution = {restitution} }}]
[[scene.statics]]
name = "plate"
shape = {{ type = "box", half_width = "= half", half_height = 0.1 }}
position = ["= middle", 0]
[scene.goal]
type = "contact"
bodies = ["red", "plate"]
[scene.action]
components = [
  {{ target = "red", set = "x", low = -4, high = 4 }},
  {{ target = "red", set = "y", low = 1, high = 2 }},
]
discrete = {{ type = "sequence", count = 500 }}
[real]
density = {density}
friction = {friction}
restitution = {restitution}
damping = {damping}
[tasks]
train = 2
validation = 1
test = 1
sample = 100
bins = [{{ from = 0.05, to = 0.5, tasks = 4 }}]
"""
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
PROGRAM = os.environ.get("IPLW_BIN", "iplw")
TRIALS = "trial,t,body,x,y\n" + "".join(
    f"{trial},{0.02 * i},red,{(0.2 + 0.1 * trial) * i},{1 + 0.06 * i - 4.9 * (0.02 * i) ** 2}\n"
    for trial in range(6)
    for i in range(20)
)
SCENE = {
    "format": "iplw.scene/1",
    "bodies": [{"name": "red", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 1], "velocity": [2, 3]}],
    "time_step": 0.005,
    "steps": 160,
    "observe_every": 20,
}


class Hidden:
    """Hidden numbers of nine random digits, and the search for them."""

    def __init__(self, seed: int) -> None:
        draw = random.Random(seed)
        ranges = {"density": (0.5, 2.0), "friction": (0.2, 0.8), "restitution": (0.2, 0.8), "damping": (0.5, 0.9)}
        self.numbers = {name: round(draw.uniform(*ends), 9) for name, ends in ranges.items()}
        drag = -math.log(self.numbers["damping"])
        self._wanted = [*self.numbers.values(), drag]

    def check(self, place: str, data: bytes) -> None:
        """Fails if the data contain a hidden number, as text or as a binary number of 64 or 32 bits."""
        found = np.array([float(text) for text in NUMBER.findall(data) if len(text) > 6])
        for value in self._wanted:
            if found.size:
                assert np.abs(found - value).min() > 3e-9 * value, f"{place} contains {value}"
            for code in ("<d", ">d", "<f", ">f"):
                assert struct.pack(code, value) not in data, f"{place} contains {value} as {code}"


class Server:
    """A server with the family, and everything that it has answered."""

    def __init__(self, folder: Path, data: Path) -> None:
        arguments = [PROGRAM, "serve", "--http", "127.0.0.1:0", "--tasks", str(folder), "--data-dir", str(data)]
        self.process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if address := re.search(rb"http://127\.0\.0\.1:\d+", line):
                self.base = address.group().decode()
                break
        self.answers: dict[str, bytes] = {}

    def ask(self, name: str, method: str, path: str, body: Any = None, *, kind: str = "application/json", ok: bool = True) -> Any:
        """Sends a request and stores the answer of the operation `name`; returns its JSON."""
        data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        request = urllib.request.Request(self.base + path, data=data, method=method, headers={"content-type": kind})
        try:
            with urllib.request.urlopen(request, timeout=60) as response:
                status, answer, is_json = response.status, response.read(), "json" in (response.headers["content-type"] or "")
        except urllib.error.HTTPError as error:
            status, answer, is_json = error.code, error.read(), True
        assert not ok or status < 400, f"{name}: {answer.decode()}"
        self.answers[name] = self.answers.get(name, b"") + answer
        return json.loads(answer) if is_json and answer else None

    def job(self, name: str, path: str, body: Any) -> Any:
        """Starts a job and waits for it."""
        job = self.ask(name, "POST", path, body)
        while job["state"] not in ("succeeded", "failed", "cancelled"):
            time.sleep(0.1)
            job = self.ask("get_job", "GET", f"/v1/jobs/{job['id']}")
        assert job["state"] == "succeeded", job["error"]
        return job


@pytest.fixture(scope="module")
def hidden() -> Hidden:
    """Numbers of their own for each run."""
    return Hidden(time.time_ns())


@pytest.fixture(scope="module")
def folder(hidden: Hidden, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the family and its certified tasks."""
    folder = tmp_path_factory.mktemp("families")
    (folder / "drop.toml").write_text(FAMILY.format(**hidden.numbers))
    subprocess.run([PROGRAM, "tasks", "check", str(folder / "drop.toml")], check=True, capture_output=True)
    return folder


@pytest.fixture
def server(folder: Path, tmp_path: Path) -> Iterator[Server]:
    """A server with the family."""
    server = Server(folder, tmp_path / "data")
    yield server
    server.process.terminate()
    server.process.wait(30)


def _worlds(server: Server) -> None:
    ask = server.ask
    real = ask("create_world", "POST", "/v1/worlds", {"task": "drop", "kind": "real", "noise": 0.01})["id"]
    sim = ask("create_world", "POST", "/v1/worlds", {"task": "drop"})["id"]
    ask("create_world", "POST", "/v1/worlds", {"task": "drop", "kind": "real", "sealed": False}, ok=False)
    for world in (real, sim):
        ask("get_world", "GET", f"/v1/worlds/{world}")
        ask("reset_world", "POST", f"/v1/worlds/{world}/reset", {"task": "drop:000"})
        ask("step_world", "POST", f"/v1/worlds/{world}/step", {"action": [0.1, 0.4]})
        ask("rollout_world", "POST", f"/v1/worlds/{world}/rollout", {"task": "drop:000", "actions": [[0.3, 0.4], [0.6, 0.2]], "trajectories": True})
        ask("render_world", "GET", f"/v1/worlds/{world}/render")
        ask("set_latents", "POST", f"/v1/worlds/{world}/set_latents", {"friction": 0.3}, ok=world == sim)
        ask("snapshot_world", "POST", f"/v1/worlds/{world}/snapshot", {"action": [0.3, 0.4], "at": 0.5, "task": "drop:000"}, ok=False)
        ask("branch_world", "POST", f"/v1/worlds/{world}/branch", {"snapshot": {}}, ok=False)
    made = ask("create_worlds", "POST", "/v1/batch/worlds", {"task": "drop", "kind": "real", "count": 2})
    ids = made["worlds"]
    ask("reset_worlds", "POST", "/v1/batch/reset", {"worlds": ids})
    ask("step_worlds", "POST", "/v1/batch/step", {"worlds": ids, "actions": [[0.2, 0.4], [0.5, 0.5]]})
    ask("delete_worlds", "DELETE", "/v1/batch/worlds", {"worlds": ids})
    with urllib.request.urlopen(f"{server.base}/v1/worlds/{real}/events", timeout=60) as stream:
        server.answers["watch_world"] = stream.read1(65536)
    ask("list_control_tasks", "GET", "/v1/control/tasks")
    control = ask("create_control_world", "POST", "/v1/control/worlds", {"task": "pendulum_swing_up", "kind": "real"})["id"]
    base = f"/v1/control/worlds/{control}"
    ask("get_control_world", "GET", base)
    ask("reset_control_world", "POST", f"{base}/reset", {"seed": 1})
    ask("step_control_world", "POST", f"{base}/step", {"actions": [[0.3]]})
    ask("render_control_world", "GET", f"{base}/render")
    ask("rollout_control_world", "POST", f"{base}/rollout", {"actions": [[[0.3]]]}, ok=False)
    ask("set_control_physics", "POST", f"{base}/set_physics", {}, ok=False)
    ask("delete_control_world", "DELETE", base)
    ask("list_worlds", "GET", "/v1/worlds")
    ask("delete_world", "DELETE", f"/v1/worlds/{sim}")


def _jobs(server: Server) -> None:
    ask, job = server.ask, server.job
    real = ask("create_world", "POST", "/v1/worlds", {"task": "drop", "kind": "real", "noise": 0.01})["id"]
    fit = job("start_iplw", "/v1/iplw", {"task": "drop", "world": real, "rounds": 2, "actions": 4})["id"]
    for name, path in (("list_rounds", "rounds"), ("list_proposals", "proposals")):
        ask(name, "GET", f"/v1/iplw/{fit}/{path}", ok=False)
    ask("submit_trials", "POST", f"/v1/iplw/{fit}/trials", {"trials": []}, ok=False)
    for name, path in (("list_trials", "trials"), ("get_job_log", "log"), ("follow_job", "events")):
        ask(name, "GET", f"/v1/jobs/{fit}/{path}")
    data = {"scene": SCENE, "trials": TRIALS}
    diagnosis = job("start_diagnosis", "/v1/diagnoses", data)["id"]
    for made in (fit, diagnosis):
        ask("get_report", "GET", f"/v1/jobs/{made}/report")
    ask("list_diagnosis_trials", "GET", f"/v1/diagnoses/{diagnosis}/trials")
    policy = job("train_policy", "/v1/policies", {"task": "drop", "batches": 20})["result"]["policy"]
    job("evaluate_policy", f"/v1/policies/{policy}/evaluate", {"world": real})
    job("learn_policy", f"/v1/policies/{policy}/learn", {"world": real, "attempts": 30, "batches": 5})
    ask("act", "POST", f"/v1/policies/{policy}/act", {"task": "drop:003", "count": 3})
    for name, path in (("list_policies", ""), ("get_policy", f"/{policy}"), ("download_weights", f"/{policy}/weights")):
        ask(name, "GET", f"/v1/policies{path}")
    ask("upload_weights", "PUT", f"/v1/policies/{policy}/weights", b"", kind="application/octet-stream", ok=False)
    job("start_plan", "/v1/plans", {"task": "drop:000", "actions": 40, "draws": 4})
    job("start_design", "/v1/designs", {"task": "drop", "question": "latents", "candidates": 8})
    job("start_posterior", "/v1/posteriors", {**data, "draws": 256, "sets": [["linear_drag"]]})
    likelihood = job("start_likelihood", "/v1/likelihoods", {**data, "effects": ["linear_drag"]})["id"]
    ask("evaluate_likelihood", "POST", f"/v1/likelihoods/{likelihood}/evaluate", {"columns": {}}, ok=False)
    ask("draw_starts", "POST", f"/v1/likelihoods/{likelihood}/starts", {"count": 2, "seed": 1}, ok=False)
    surface = job("find_surface", "/v1/surfaces", {"task": "drop", "points": 8})["result"]["surface"]
    for name, path in (("list_surfaces", ""), ("get_surface", f"/{surface}"), ("draw_surface", f"/{surface}/picture")):
        ask(name, "GET", f"/v1/surfaces{path}")
    ask("delete_surface", "DELETE", f"/v1/surfaces/{surface}")
    ask("delete_policy", "DELETE", f"/v1/policies/{policy}")
    ask("list_jobs", "GET", "/v1/jobs")
    ask("update_job", "PATCH", f"/v1/jobs/{fit}", {"name": "drop", "note": "first"})
    ask("delete_job", "DELETE", f"/v1/jobs/{fit}")


def _catalogue(server: Server) -> None:
    ask = server.ask
    for name, path in (
        ("healthz", "/healthz"),
        ("readyz", "/readyz"),
        ("metrics", "/metrics"),
        ("openapi", "/openapi.json"),
        ("list_effects", "/v1/effects"),
        ("get_limits", "/v1/limits"),
        ("list_families", "/v1/tasks"),
        ("list_tasks", "/v1/tasks/drop"),
        ("get_task", "/v1/tasks/drop/000"),
    ):
        ask(name, "GET", path)
    ask("list_tokens", "GET", "/v1/tokens", ok=False)
    ask("make_token", "POST", "/v1/tokens", {"name": "a", "scopes": ["read"]}, ok=False)
    ask("revoke_token", "DELETE", "/v1/tokens/none", ok=False)
    ask("place", "POST", "/v1/place", {"task": "drop:000", "actions": [[0.1, 0.4]]})
    ask("simulate", "POST", "/v1/simulate", {"scene": SCENE})


def test_no_answer_of_the_server_contains_hidden_numbers(server: Server, hidden: Hidden) -> None:
    _catalogue(server)
    _worlds(server)
    _jobs(server)
    document = server.ask("openapi", "GET", "/openapi.json")
    operations = {
        operation["operationId"] for path in document["paths"].values() for method, operation in path.items() if method != "parameters"
    }
    assert operations <= set(server.answers), f"not asked: {sorted(operations - set(server.answers))}"
    for name, answer in server.answers.items():
        hidden.check(name, answer)


COMMANDS = [
    "tasks drop",
    "measure --task drop --trials 8 --noise 0.01 --out measured",
    "estimate --task drop --real noise=0.01 --rounds 2 --actions 4 --json",
    "train --task drop --batches 20 --per-task 50 --out policy.safetensors",
    "evaluate --task drop --policy policy.safetensors --candidates 50 --json",
    "outcomes --task drop --actions 60 --out outcomes",
    "outcomes --task drop --actions 60 --world real --out outcomes_real",
    "plan --task drop:000 --actions 40 --draws 4 --json",
    "diagnose --scene measured/scene.json --trials measured/trials.csv --out diagnosis",
    "posterior --scene measured/scene.json --trials measured/trials.csv --draws 256 --out posterior",
    "surface --task drop --points 8 --out surface.json",
    "design --task drop --question latents --candidates 8 --out design",
]


def test_no_command_prints_or_writes_hidden_numbers(folder: Path, hidden: Hidden, tmp_path: Path) -> None:
    for command in COMMANDS:
        done = subprocess.run(
            [PROGRAM, *command.split(), "--tasks", str(folder)], cwd=tmp_path, capture_output=True, check=False
        )
        assert done.returncode == 0, f"{command}: {done.stderr.decode()}"
        hidden.check(command, done.stdout + done.stderr)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) > 10
    for path in files:
        hidden.check(str(path), path.read_bytes())


def test_the_search_finds_hidden_numbers(hidden: Hidden) -> None:
    """The search itself works: a number is found as text, and in binary form."""
    for value in hidden.numbers.values():
        for data in (f'{{"x": {value}}}'.encode(), f"{value:.12e}".encode(), struct.pack("<d", value), struct.pack("<f", value)):
            with pytest.raises(AssertionError):
                hidden.check("here", data)
