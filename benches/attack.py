"""Attacks a server with the dearest requests that it accepts, and measures what they cost it and other clients.

    python benches/attack.py [--binary target/release/iplw] [--only deadline|memory|floods] [--case WORD]

deadline: for every operation of the OpenAPI document, processor time that the server spends after a request's deadline of 0.5 s,
after its client hung up, and after its job was cancelled.
memory: peak resident memory of single requests and jobs, above that of an idle server.
floods: how another client fares while one floods the server.

Each prints a table; exit code 1 if a figure is above what is wanted. Uses only the standard library; starts its own servers on free
ports of this machine, and needs /proc. Takes about half an hour.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import http.client
import json
import math
import multiprocessing
import os
import resource
import signal
import socket
import statistics
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import asking
from asking import Server, ask, server

# Wanted at most.
BUSY_SECONDS = 0.2
MEGABYTES = 512.0
P99_RATIO = 3.0
START_SECONDS = 60.0

DEADLINE = 0.5
# A server that computes on for longer is replaced.
PATIENCE = 4.0
# Processor time within a span that counts as idle, s: timers and the log.
IDLE_SPAN, IDLE_USE = 0.3, 0.003
# A body may have 16 MiB; the rest is left for the other fields.
WHOLE_BODY = 16 * 1024 * 1024 - 4096

JSON, MSGPACK, CSV, BYTES = "application/json", "application/msgpack", "text/csv", "application/octet-stream"
Document = dict[str, Any]


# Bodies.


def regular(corners: int, radius: float, turned: float = 0.0) -> Document:
    """A regular polygon."""
    angles = [turned + 2 * math.pi * k / corners for k in range(corners)]
    return {
        "type": "polygon",
        "vertices": [[round(radius * math.cos(a), 5), round(radius * math.sin(a), 5)] for a in angles],
    }


def scene(bodies: list[Document], statics: list[Document], **fields: Any) -> Document:
    """A scene whose action throws the first body, and whose goal is out of reach."""
    name = bodies[0]["name"]
    throw = [{"target": name, "set": quantity, "low": 0.0, "high": 1.0} for quantity in ("vx", "vy")]
    return {
        "format": "iplw.scene/1",
        "bodies": bodies,
        "statics": statics,
        "time_step": 0.01,
        "steps": 1_000_000,
        "observe_every": 10_000,
        "goal": {"type": "above", "body": name, "height": 9e4},
        "action": {"components": throw},
        **fields,
    }


FLOOR: Document = {"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}
BALL: Document = {"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0.0, 0.5]}


def boxes(**fields: Any) -> Document:
    """Sixty boxes that never come to rest."""
    heap = [
        {
            "name": f"b{i}",
            "shape": {"type": "box", "half_width": 0.2, "half_height": 0.2},
            "friction": 0.0,
            "restitution": 1.0,
            "position": [0.45 * (i % 10), 0.3 + 0.45 * (i // 10)],
            "velocity": [7 * i % 5 - 2.0, 3 * i % 7 - 3.0],
        }
        for i in range(60)
    ]
    sides: list[tuple[list[int], int]] = [([0, 1], 0), ([0, -1], -6), ([1, 0], -1), ([-1, 0], -6)]
    walls = [
        {
            "name": f"w{k}",
            "shape": {"type": "halfspace", "normal": normal, "offset": offset},
            "friction": 0.0,
            "restitution": 1.0,
        }
        for k, (normal, offset) in enumerate(sides)
    ]
    return scene(heap, walls, gravity=[0, 0], **fields)


def polygons() -> tuple[list[Document], list[Document]]:
    """As many bodies and statics as a scene may have, of as many corners as a polygon may have."""
    bodies = [{"name": f"b{i}", "shape": regular(32, 0.3), "position": [i, 1.0]} for i in range(64)]
    statics = [{"name": f"s{i}", "shape": regular(32, 0.3), "position": [i % 64, -1.0 - i // 64]} for i in range(256)]
    return bodies, statics


def settings(count: int = 50_000) -> Document:
    """Polygons in many settings, of which each is validated."""
    bodies, statics = polygons()
    return scene(bodies, statics, settings={f"s{i}": {} for i in range(count)})


def overrides(count: int = 2000) -> Document:
    """As many corners, and as many in settings, as a scene may have."""
    bodies, statics = polygons()
    other = {f"s{i}": {"bodies": {"b0": {"shape": regular(32, 0.31)}}} for i in range(count)}
    return scene(bodies, statics[:63], steps=1400, settings={**other, **{f"t{i}": {} for i in range(25_000)}})


def compounds(count: int = 64, statics: int = 160, corners: int = 32) -> Document:
    """Compounds along diagonals: all their boxes overlap, and no two of their pieces do."""

    def stripe(i: int, corners: int) -> Document:
        pieces = [{**regular(corners, 0.1), "position": [0.5 * k + 0.001 * i, 0.5 * k - 0.3 * i]} for k in range(32)]
        return {"type": "compound", "pieces": pieces}

    bodies = [{"name": f"b{i}", "shape": stripe(i, corners), "position": [0.0, 0.0]} for i in range(count)]
    fixed = [{"name": f"s{i}", "shape": stripe(i + count, 6), "position": [0.0, 0.0]} for i in range(statics)]
    return scene(bodies, fixed, time_step=0.0001, steps=2000, observe_every=1)


def region(corners: int = 170_000) -> Document:
    """A goal region of many corners, which every step tests."""
    angles = (2 * math.pi * k / corners for k in range(corners))
    ring = [[round(50_000 + 40 * math.cos(a), 5), round(40 * math.sin(a), 5)] for a in angles]
    return scene([BALL], [FLOOR], gravity=[0, 0], goal={"type": "inside", "body": "ball", "region": ring})


def carriers(count: int = 800_000) -> Document:
    """A list of carriers of latents that names a static again and again."""
    bodies, statics = polygons()
    return scene(bodies, statics, carriers=["s255"] * count)


def listed(field: str, value: Any, count: int) -> Document:
    """A list of a scene that repeats one value."""
    return scene([BALL], [FLOOR], **{field: [value] * count})


SCENES: dict[str, Callable[[], Document]] = {
    "60 boxes, 800,000 steps": lambda: boxes(steps=800_000),
    "60 boxes, 59 s": lambda: boxes(steps=5900, observe_every=1),
    "50,000 settings of 320 polygons": settings,
    "224 compounds of 32 pieces": compounds,
    "16 compounds of 32 pieces": lambda: compounds(16, 0, 8),
    "32 compounds of 32 pieces": lambda: compounds(32, 0, 4),
    "2000 overrides in settings": overrides,
    "a region of 4000 corners": lambda: region(4000),
    "a region of 170,000 corners": region,
    "800,000 carriers": carriers,
    "28,000 effects": lambda: listed("effects", {"name": "linear_drag", "parameters": {}}, 28_000),
    "900,000 latents to calibrate": lambda: listed("calibrate", "friction", 900_000),
    "900,000 quantities per setting": lambda: listed("per_setting", "friction", 900_000),
}

READING: Document = {"length_unit": "m", "time_unit": "s", "y_down": False}
THROWN: Document = {"radius": 0.02, "mass": 0.0027}


def tracks(megabytes: float, samples: int = 100) -> str:
    """Tracks of a thrown ball, with noise, of about this size."""
    rows = ["trial,t,x,y\n"]
    size, trial = 0, 0
    while size < 1e6 * megabytes - 30 * samples:
        speed = 1 + trial % 10 / 9
        for i in range(samples):
            t = i / 100
            noise = 0.001 * ((7919 * i + trial) % 5 - 2)
            rows.append(f"{trial},{t:.2f},{speed * t + noise:.3f},{3 * t - 4.9 * t * t + noise:.3f}\n")
            size += len(rows[-1])
        trial += 1
    return "".join(rows)


def measured(megabytes: float, **fields: Any) -> Document:
    return {"ball": THROWN, "reading": READING, "trials": tracks(megabytes), **fields}


def proposal_rows(trials: int, megabytes: float) -> str:
    """A trials file of few long trials."""
    rows, size, each = ["trial,t,body,x,y\n"], 0, 1e6 * megabytes / trials
    for trial in range(trials):
        size, i = 0, 0
        while size < each - 40:
            rows.append(f"{trial},{i / 1e5:.5f},ball,{i % 97 / 100:.2f},{0.5 + i % 89 / 100:.2f}\n")
            size += len(rows[-1])
            i += 1
    return "".join(rows)


def wide(head: str, item: str, tail: str, count: int = 1_000_000) -> bytes:
    """JSON with one long list."""
    return (head + ",".join([item] * count) + tail).encode()


# Requests.


@dataclass
class Request:
    method: str
    path: str
    body: bytes = b""
    kind: str = JSON

    def on_wire(self, token: str, deadline: float | None) -> bytes:
        head = f"{self.method} {self.path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\n"
        head += f"X-Deadline: {deadline}\r\n" if deadline else ""
        head += f"Content-Type: {self.kind}\r\nContent-Length: {len(self.body)}\r\n\r\n"
        return head.encode() + self.body


def get(path: str) -> Request:
    return Request("GET", path)


def post(path: str, body: Document | bytes) -> Request:
    return Request(
        "POST", path, body if isinstance(body, bytes) else json.dumps(body, separators=(",", ":")).encode()
    )


def packed(path: str, body: Document) -> Request:
    return Request("POST", path, asking.packed(body), MSGPACK)


@dataclass
class Answer:
    """Status 0: none arrived."""

    status: int
    begin: bytes
    finished: bool


def read_until(one: socket.socket, until: float, begun: bytes = b"") -> tuple[bytes, int, bool]:
    """What arrives until a time: its begin, its size, and whether the response is whole."""
    begin, size, length = bytearray(begun), len(begun), None
    while (left := until - time.perf_counter()) > 0:
        one.settimeout(left)
        try:
            part = one.recv(1 << 20)
        except TimeoutError:
            break
        except OSError:
            return bytes(begin), size, True
        size += len(part)
        begin += part if len(begin) < 1 << 24 else b""
        head, found, _ = bytes(begin[:8192]).partition(b"\r\n\r\n")
        if found and length is None:
            told = [line for line in head.lower().split(b"\r\n") if line.startswith(b"content-length:")]
            length = len(head) + 4 + int(told[0].split(b":")[1]) if told else -1
        ended = length == -1 and begin.endswith(b"0\r\n\r\n") or part.endswith(b"\r\n0\r\n\r\n")
        if not part or (length is not None and 0 <= length <= size) or ended:
            return bytes(begin), size, True
        if length == -1 and head.startswith(b"HTTP/1.1 204"):
            return bytes(begin), size, True
    return bytes(begin), size, False


def status_of(begin: bytes) -> int:
    return int(begin[9:12]) if begin.startswith(b"HTTP/1.1 ") else 0


class Stage:
    """A server with an administrator's token, and what the cases need on it; made when it is asked for."""

    def __init__(self, binary: str, running: Server, token: str):
        self.binary, self.running, self.token = binary, running, token
        self.made: dict[str, Any] = {}

    def ask(self, method: str, path: str, body: object = None) -> tuple[int, Document]:
        connection = self.running.connect()
        try:
            return ask(connection, method, path, body, Authorization=f"Bearer {self.token}")
        finally:
            connection.close()

    def send(self, request: Request, seconds: float = 60.0) -> Answer:
        with socket.create_connection(("127.0.0.1", self.running.http)) as one:
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                one.sendall(request.on_wire(self.token, None))
            begin, _, finished = read_until(one, time.perf_counter() + seconds)
        return Answer(status_of(begin), begin, finished)

    def made_once(self, name: str, make: Callable[[], Any]) -> Any:
        if name not in self.made:
            try:
                self.made[name] = make()
            except (AssertionError, OSError, LookupError, TypeError, http.client.HTTPException) as e:
                self.made[name] = e
        if isinstance(self.made[name], Exception):
            raise self.made[name]
        return self.made[name]

    def idle(self, patience: float = PATIENCE) -> tuple[float, bool]:
        """Waits until the server is idle; its processor time until then, s, and whether it became idle."""
        start = last = seen = self.running.processor_seconds()
        since, until = time.perf_counter(), time.perf_counter() + patience
        while (now := time.perf_counter()) < until:
            used = self.running.processor_seconds()
            if used - seen > IDLE_USE:
                since, seen, last = now, used, used
            if now - since > IDLE_SPAN:
                return last - start, True
            time.sleep(0.01)
        return self.running.processor_seconds() - start, False

    def forget_jobs(self) -> None:
        for state in ("queued", "running", "waiting"):
            rows = self.ask("GET", f"/v1/jobs?results=false&limit=1000&state={state}")[1].get("jobs", [])
            for row in rows:
                self.ask("DELETE", f"/v1/jobs/{row['id']}")

    def job(self, path: str, body: Document, states: tuple[str, ...] = ("succeeded",)) -> Document:
        """A job in one of these states."""
        status, made = self.ask("POST", path, body)
        assert status in (200, 202), made
        while True:
            row = self.ask("GET", f"/v1/jobs/{made['id']}")[1]
            if row["state"] in states:
                return row
            assert row["state"] in ("queued", "running"), row
            time.sleep(0.05)

    # What the cases need.

    def world(self, name: str = "60 boxes, 800,000 steps", **fields: Any) -> str:
        def make() -> str:
            status, made = self.ask("POST", "/v1/worlds", {"scene": SCENES[name](), **fields})
            assert status == 201, (name, str(made)[:300])
            assert self.ask("POST", f"/v1/worlds/{made['id']}/reset", {})[0] == 200
            return str(made["id"])

        return str(self.made_once(f"world {name} {sorted(fields)}", make))

    def control_world(self) -> str:
        def make() -> str:
            status, made = self.ask("POST", "/v1/control/worlds", {"task": "reacher", "count": 4096})
            assert status == 201, made
            assert self.ask("POST", f"/v1/control/worlds/{made['id']}/reset", {"seed": 1})[0] == 200
            return str(made["id"])

        return str(self.made_once("control world", make))

    def worlds(self, count: int = 2000) -> list[str]:
        def make() -> list[str]:
            status, made = self.ask("POST", "/v1/batch/worlds", {"count": count, "task": "bowling"})
            assert status == 201, made
            ids = [str(one) for one in made["worlds"]]
            assert self.ask("POST", "/v1/batch/reset", {"worlds": ids})[0] == 200
            return ids

        return list(self.made_once("worlds", make))

    def policy(self) -> str:
        def make() -> str:
            row = self.job("/v1/policies", {"task": "bowling", "batches": 1, "batch_size": 2})
            return str(row["result"]["policy"])

        return str(self.made_once("policy", make))

    def weights(self) -> bytes:
        def make() -> bytes:
            connection = self.running.connect()
            head = {"Authorization": f"Bearer {self.token}"}
            connection.request("GET", f"/v1/policies/{self.policy()}/weights", headers=head)
            return connection.getresponse().read()

        return bytes(self.made_once("weights", make))

    def likelihood(self) -> Document:
        body = measured(0.05, effects=["linear_drag", "wind"])
        found: Document = self.made_once("likelihood", lambda: self.job("/v1/likelihoods", body))
        return found

    def points(self, count: int) -> Document:
        rows = self.likelihood()["result"]["parameters"]
        return {"columns": {row["name"]: [row["fit"] + 1e-6 * i for i in range(count)] for row in rows}}

    def diagnosis(self) -> str:
        """With as many rows as one may have; its work is cancelled."""

        def make() -> str:
            status, made = self.ask("POST", "/v1/diagnoses", measured(0.9))
            assert status == 202, str(made)[:300]
            self.ask("DELETE", f"/v1/jobs/{made['id']}")
            return str(made["id"])

        return str(self.made_once("diagnosis", make))

    def estimation(self, name: str) -> str:
        """One that waits for trials of four proposals."""
        table = scene([BALL], [FLOOR], steps=250, observe_every=10, time_step=0.004, calibrate=["friction"])
        del table["goal"]
        body = {"scene": table, "real": "ask_tell", "actions": 4}
        return str(self.made_once(f"estimation {name}", lambda: self.job("/v1/iplw", body, ("waiting",)))["id"])

    def submitted(self) -> str:
        """An estimation with 9 MB of submitted trials."""

        def make() -> str:
            job = self.estimation("submitted")
            rows = proposal_rows(3, 9.0).encode()
            answer = self.send(Request("POST", f"/v1/iplw/{job}/trials", rows, CSV))
            assert answer.status == 200, answer.begin[-300:]
            return job

        return str(self.made_once("submitted", make))

    def surface(self) -> str:
        def make() -> str:
            row = self.job("/v1/surfaces", {"task": "bowling", "points": 60, "actions": 20})
            return str(row["result"]["surface"])

        return str(self.made_once("surface", make))

    def snapshot(self) -> Document:
        body = {"action": [0.5, 0.5], "at": 1.0}
        return dict(
            self.made_once(
                "snapshot", lambda: self.ask("POST", f"/v1/worlds/{self.world()}/snapshot", body)[1]["snapshot"]
            )
        )


@contextlib.contextmanager
def stage(binary: str, **limits: float) -> Iterator[Stage]:
    with tempfile.TemporaryDirectory() as place:
        token = asking.new_token(binary, place, "mallory", "admin")
        with server(binary, "--data-dir", place, limits=limits, zmq=True) as running:
            yield Stage(binary, running, token)


# Cases of every operation.


@dataclass
class Case:
    """A dear request of an operation. `job`: it queues a job."""

    operation: str
    what: str
    make: Callable[[Stage], Request]
    job: bool = False


Make = Callable[[Stage], Request]


def reading_cases() -> Iterator[Case]:
    """Operations without a body."""
    plain = {
        "healthz": "/healthz",
        "readyz": "/readyz",
        "openapi": "/openapi.json",
        "get_limits": "/v1/limits",
        "list_effects": "/v1/effects",
        "list_families": "/v1/tasks",
        "list_tasks": "/v1/tasks/bowling?limit=1000",
        "get_task": "/v1/tasks/bowling/017",
        "list_tokens": "/v1/tokens?limit=1000",
    }
    for operation, path in plain.items():
        yield Case(operation, "as it is", lambda _, path=path: get(path))  # type: ignore[misc]

    def among_worlds(path: str) -> Make:
        def make(s: Stage) -> Request:
            s.worlds()
            return get(path)

        return make

    yield Case("metrics", "among 2000 worlds", among_worlds("/metrics"))
    yield Case("list_worlds", "1000 of 2000 worlds", among_worlds("/v1/worlds?limit=1000"))
    yield Case("get_world", "of compounds", lambda s: get(f"/v1/worlds/{s.world('16 compounds of 32 pieces')}"))
    yield Case(
        "watch_world", "of compounds", lambda s: get(f"/v1/worlds/{s.world('16 compounds of 32 pieces')}/events")
    )
    yield Case(
        "list_diagnosis_trials", "0.9 MB of tracks", lambda s: get(f"/v1/diagnoses/{s.diagnosis()}/trials?limit=1000")
    )
    yield Case("get_job", "0.9 MB of tracks", lambda s: get(f"/v1/jobs/{s.diagnosis()}"))
    yield Case("get_report", "0.9 MB of tracks", lambda s: get(f"/v1/jobs/{s.diagnosis()}/report"))
    yield Case("get_job_log", "of a diagnosis", lambda s: get(f"/v1/jobs/{s.diagnosis()}/log?limit=1000"))
    yield Case("follow_job", "of a diagnosis", lambda s: get(f"/v1/jobs/{s.diagnosis()}/events"))

    def jobs(s: Stage) -> Request:
        s.diagnosis()
        s.submitted()
        return get("/v1/jobs?limit=1000")

    yield Case("list_jobs", "with large inputs", jobs)
    yield Case("list_proposals", "four", lambda s: get(f"/v1/iplw/{s.submitted()}/proposals"))
    yield Case("list_rounds", "of an estimation", lambda s: get(f"/v1/iplw/{s.submitted()}/rounds?limit=1000"))
    for form in ("json", "csv", "scene"):
        yield Case("list_trials", f"9 MB as {form}", lambda s, form=form: get(f"/v1/jobs/{s.submitted()}/trials?format={form}"))  # type: ignore[misc]
    yield Case("list_policies", "one", lambda s: get("/v1/policies?limit=1000"))
    yield Case("get_policy", "1 MB", lambda s: get(f"/v1/policies/{s.policy()}"))
    yield Case("download_weights", "1 MB", lambda s: get(f"/v1/policies/{s.policy()}/weights"))
    yield Case("list_surfaces", "one", lambda s: get(f"/v1/surfaces?limit={len(s.surface()[:0]) + 1000}"))
    yield Case("get_surface", "60 points", lambda s: get(f"/v1/surfaces/{s.surface()}"))
    yield Case("draw_surface", "60 points", lambda s: get(f"/v1/surfaces/{s.surface()}/picture"))
    for view in ("scene", "end", "filmstrip", "animation", "film"):
        for name in ("60 boxes, 800,000 steps", "60 boxes, 59 s", "16 compounds of 32 pieces"):
            for form in ("png", "svg"):
                if (view == "animation") != (form == "svg") and view in ("animation", "film"):
                    continue
                query = f"view={view}&width={400 if view == 'film' else 2048}&format={form}" + (
                    "" if view == "scene" else "&action=0.5,0.5"
                )
                query += "&fps=60" if view == "film" else ""
                yield Case(
                    "render_world",
                    f"{view} as {form}, {name}",
                    lambda s, name=name, query=query: get(f"/v1/worlds/{s.world(name)}/render?{query}"),  # type: ignore[misc]
                )


def deleting_cases() -> Iterator[Case]:
    def deleted_world(s: Stage) -> Request:
        made = s.ask("POST", "/v1/worlds", {"scene": compounds(16, 0, 8)})[1]
        return Request("DELETE", f"/v1/worlds/{made.get('id')}")

    def deleted_worlds(s: Stage) -> Request:
        ids = s.worlds()
        s.made.pop("worlds")
        return Request("DELETE", "/v1/batch/worlds", json.dumps({"worlds": ids}).encode())

    def deleted_job(s: Stage) -> Request:
        job = s.diagnosis()
        s.made.pop("diagnosis")
        return Request("DELETE", f"/v1/jobs/{job}")

    def deleted_policy(s: Stage) -> Request:
        answer = s.send(Request("PUT", "/v1/policies/gone/weights", s.weights(), BYTES))
        assert answer.status in (200, 201), answer.begin[-300:]
        return Request("DELETE", "/v1/policies/gone")

    def deleted_surface(s: Stage) -> Request:
        found = s.surface()
        s.made.pop("surface")
        return Request("DELETE", f"/v1/surfaces/{found}")

    def revoked(s: Stage) -> Request:
        s.ask("POST", "/v1/tokens", {"name": "guest", "scope": "read"})
        return Request("DELETE", "/v1/tokens/guest")

    yield Case("delete_world", "of compounds", deleted_world)
    yield Case("delete_worlds", "2000", deleted_worlds)
    yield Case(
        "update_job",
        "a note of 16 MB",
        lambda s: Request("PATCH", f"/v1/jobs/{s.diagnosis()}", json.dumps({"note": "n" * WHOLE_BODY}).encode()),
    )
    yield Case("delete_job", "0.9 MB of tracks", deleted_job)
    yield Case("delete_policy", "1 MB", deleted_policy)
    yield Case("delete_surface", "60 points", deleted_surface)
    yield Case(
        "make_token", "a name of 16 MB", lambda s: post("/v1/tokens", {"name": "n" * WHOLE_BODY, "scope": "read"})
    )
    yield Case("revoke_token", "one", revoked)


def scene_cases() -> Iterator[Case]:
    """Operations that take a scene, each with every dear scene."""
    for name, make in SCENES.items():
        if name in ("60 boxes, 59 s", "16 compounds of 32 pieces"):
            continue
        yield Case("create_world", name, lambda _, make=make: post("/v1/worlds", {"scene": make()}))  # type: ignore[misc]
        yield Case("simulate", name, lambda _, make=make: post("/v1/simulate", {"scene": make(), "action": [0.5, 0.5]}))  # type: ignore[misc]
        yield Case(
            "place",
            f"4096 actions, {name}",
            lambda _, make=make: post("/v1/place", {"scene": make(), "actions": [[0.5, 0.5]] * 4096}),  # type: ignore[misc]
        )
        yield Case(
            "create_worlds",
            f"2000, {name}",
            lambda _, make=make: post("/v1/batch/worlds", {"scene": make(), "count": 2000}),  # type: ignore[misc]
        )

    def placed() -> Document:
        made = compounds(32, 0, 4)
        quantities = [(f"b{i}", quantity) for i in range(8) for quantity in ("x", "y")]
        components = [{"target": b, "set": q, "low": 0.0, "high": 0.001} for b, q in quantities]
        return {**made, "action": {"components": components}}

    def place_many(_: Stage) -> Request:
        return post("/v1/place", {"scene": placed(), "actions": [[0.5] * 16] * 4096})

    yield Case("place", "4096 actions of 16 components among compounds", place_many)
    yield Case(
        "place", "10^6 numbers", lambda _: post("/v1/place", wide('{"task":"bowling:000","actions":[[', "0.5", "]]}"))
    )
    yield Case(
        "place",
        "250,000 lists",
        lambda _: post("/v1/place", wide('{"task":"bowling:000","actions":[', "[]", "]}", 200_000)),
    )
    yield Case("place", "depth of 250,000", lambda _: post("/v1/place", b'{"actions":' + b"[" * 250_000))
    yield Case(
        "place",
        "10^6 numbers as msgpack",
        lambda _: packed("/v1/place", {"task": "bowling:000", "actions": [[0.5] * 1_000_000]}),
    )
    yield Case(
        "simulate",
        "4*10^6 samples",
        lambda _: post("/v1/simulate", {"scene": boxes(steps=65_000, observe_every=1), "action": [0.5, 0.5]}),
    )
    yield Case("create_world", "an unnamed field of 16 MB", lambda _: post("/v1/worlds", {"x" * WHOLE_BODY: 1}))


def control_cases() -> Iterator[Case]:
    """Operations on control worlds."""

    def base(s: Stage) -> str:
        return f"/v1/control/worlds/{s.control_world()}"

    wide_values = [[f"v{i}", " + ".join(["hinge"] * 40)] for i in range(64)]
    scene = {
        "format": "iplw.scene/2",
        "bodies": [{"name": "rod", "shape": {"type": "disc", "radius": 0.1}, "mass": 1, "position": [0, -0.5]}],
        "joints": [{"name": "hinge", "kind": "revolute", "body": "rod", "anchor": [0, 0]}],
        "motors": [{"joint": "hinge", "control": "torque", "max_torque": 1}],
        "time_step": 0.0001,
    }
    definition = {
        "format": "iplw.control/1",
        "name": "wide",
        "scene": scene,
        "interval": 1.0,
        "time_limit": 1000.0,
        "actions": {"hinge": [-1, 1]},
        "values": wide_values,
        "observations": [{"name": "v", "value": "v63"}],
        "reward": {"dense": "v63", "sparse": "v63"},
    }
    yield Case("list_control_tasks", "all", lambda _: Request("GET", "/v1/control/tasks"))
    yield Case("create_control_world", "4096 environments", lambda _: post("/v1/control/worlds", {"task": "reacher", "count": 4096}))
    yield Case("create_control_world", "64 long expressions", lambda _: post("/v1/control/worlds", {"definition": definition}))
    yield Case("get_control_world", "4096 environments", lambda s: Request("GET", base(s)))
    yield Case("reset_control_world", "4096 environments", lambda s: post(f"{base(s)}/reset", {"seed": 1}))
    yield Case(
        "step_control_world",
        "4096 environments",
        lambda s: post(f"{base(s)}/step", {"actions": [[0.1, 0.1]] * 4096, "autoreset": "same_step"}),
    )
    yield Case(
        "rollout_control_world",
        "900,000 steps",
        lambda s: post(f"{base(s)}/rollout", {"actions": [[[0.1, 0.1]] * 450] * 2000}),
    )
    yield Case("set_control_physics", "32 effects", lambda s: post(f"{base(s)}/set_physics", {"effects": [
        {"joint": "elbow", "name": "viscous_friction", "parameters": {"b": [0.0, 0.1]}}
    ] * 32}))
    yield Case("render_control_world", "4096 px", lambda s: Request("GET", f"{base(s)}/render?width=4096"))
    yield Case("delete_control_world", "unknown", lambda _: Request("DELETE", "/v1/control/worlds/none"))


def acting_cases() -> Iterator[Case]:
    """Operations on worlds."""
    long, stripes, ring = "60 boxes, 800,000 steps", "16 compounds of 32 pieces", "a region of 4000 corners"
    act = {"action": [0.5, 0.5]}
    for name in (long, stripes, ring):
        yield Case("step_world", name, lambda s, name=name: post(f"/v1/worlds/{s.world(name)}/step", act))  # type: ignore[misc]
        yield Case(
            "step_worlds",
            name,
            lambda s, name=name: post("/v1/batch/step", {"worlds": [s.world(name)], "actions": [[0.5, 0.5]]}),  # type: ignore[misc]
        )
        yield Case("reset_world", name, lambda s, name=name: post(f"/v1/worlds/{s.world(name)}/reset", {"seed": 1}))  # type: ignore[misc]
        yield Case(
            "snapshot_world",
            f"late, {name}",
            lambda s, name=name: post(f"/v1/worlds/{s.world(name)}/snapshot", {**act, "at": 0.19 if name == stripes else 7000.0}),  # type: ignore[misc]
        )
        yield Case(
            "rollout_world",
            f"with trajectories, {name}",
            lambda s, name=name: post(f"/v1/worlds/{s.world(name)}/rollout", {"actions": [[0.5, 0.5]], "trajectories": True}),  # type: ignore[misc]
        )
        yield Case("set_latents", name, lambda s, name=name: post(f"/v1/worlds/{s.world(name)}/set_latents", {"friction": 0.4}))  # type: ignore[misc]

    def batch(s: Stage) -> Request:
        return post(
            "/v1/batch/step", {"worlds": s.worlds(), "actions": [[0.5, 0.8, 0.3]] * 2000, "autoreset": "same_step"}
        )

    yield Case("step_worlds", "2000 worlds", batch)
    yield Case("reset_worlds", "2000 worlds", lambda s: post("/v1/batch/reset", {"worlds": s.worlds()}))
    yield Case(
        "reset_worlds", "900,000 names", lambda _: post("/v1/batch/reset", wide('{"worlds":[', '"a"', "]}", 900_000))
    )
    yield Case(
        "step_worlds",
        "900,000 names",
        lambda _: post("/v1/batch/step", wide('{"actions":[],"worlds":[', '"a"', "]}", 900_000)),
    )

    def many_compounds(s: Stage, operation: str) -> Request:
        def make() -> list[str]:
            status, made = s.ask("POST", "/v1/batch/worlds", {"scene": compounds(16, 0, 8), "count": 64})
            assert status == 201, str(made)[:300]
            return [str(one) for one in made["worlds"]]

        ids = s.made_once("many compounds", make)
        if operation == "reset_worlds":
            return post("/v1/batch/reset", {"worlds": ids})
        return Request("DELETE", "/v1/batch/worlds", json.dumps({"worlds": ids}).encode())

    yield Case("reset_worlds", "64 worlds of compounds", lambda s: many_compounds(s, "reset_worlds"))
    rollout = {"task": "bowling:000", "actions": [[0.5, 0.8, 0.3]] * 4096}
    yield Case("rollout_world", "4096 actions", lambda _: post("/v1/worlds/bowling-sim/rollout", rollout))
    yield Case(
        "rollout_world", "4096 actions as msgpack", lambda _: packed("/v1/worlds/bowling-sim/rollout", rollout)
    )
    added = [
        {
            "type": "add_static",
            "at": 0.0,
            "static": {"name": f"n{i}", "shape": regular(32, 0.2), "position": [500 + i, 50]},
        }
        for i in range(64)
    ]
    yield Case(
        "rollout_world",
        "64 interventions and 2000 actions",
        lambda _: post(
            "/v1/worlds/bowling-sim/rollout",
            {**rollout, "actions": [[0.5, 0.8, 0.3]] * 2000, "interventions": [added]},
        ),
    )
    small = [[{"type": "impulse", "body": "green", "impulse": [1, 0], "at": 0.01}]] * 4096
    yield Case(
        "rollout_world",
        "interventions of each of 4096 actions",
        lambda _: post("/v1/worlds/bowling-sim/rollout", {**rollout, "interventions": small}),
    )
    yield Case(
        "rollout_world",
        "180,000 empty lists of interventions",
        lambda _: post(
            "/v1/worlds/bowling-sim/rollout",
            wide('{"task":"bowling:000","actions":[0],"interventions":[', "[]", "]}", 180_000),
        ),
    )
    yield Case(
        "branch_world",
        "to the end of 800,000 steps",
        lambda s: post(f"/v1/worlds/{s.world()}/branch", {"snapshot": s.snapshot()}),
    )
    impulses = [{"type": "impulse", "body": "b0", "impulse": [1, 0], "at": 1.0 + i} for i in range(64)]
    yield Case(
        "branch_world",
        "64 interventions",
        lambda s: post(f"/v1/worlds/{s.world()}/branch", {"snapshot": s.snapshot(), "interventions": impulses}),
    )


def enlarged(weights: bytes, megabytes: float) -> bytes:
    """Weights with metadata of this size."""
    size = struct.unpack("<Q", weights[:8])[0]
    head = json.loads(weights[8 : 8 + size])
    card = json.loads(head["__metadata__"]["iplw"])
    card["trained"] = card["trained"] * int(1e6 * megabytes / len(json.dumps(card["trained"][0])))
    head["__metadata__"]["iplw"] = json.dumps(card)
    text = json.dumps(head).encode()
    return struct.pack("<Q", len(text)) + text + weights[8 + size :]


def policy_cases() -> Iterator[Case]:
    yield Case("upload_weights", "1 MB", lambda s: Request("PUT", "/v1/policies/p/weights", s.weights(), BYTES))
    yield Case(
        "upload_weights",
        "13 MB of metadata",
        lambda s: Request("PUT", "/v1/policies/p/weights", enlarged(s.weights(), 13.0), BYTES),
    )
    count = {"task": "bowling:000", "count": 10_000}
    yield Case("act", "10,000 at random", lambda _: post("/v1/policies/random/act", count))
    yield Case("act", "10,000 of a network", lambda s: post(f"/v1/policies/{s.policy()}/act", count))
    yield Case(
        "train_policy",
        "batches of 4096",
        lambda _: post(
            "/v1/policies", {"task": "bowling", "batches": 100_000, "batch_size": 4096, "validations": 100}
        ),
        job=True,
    )
    yield Case(
        "learn_policy",
        "100,000 attempts",
        lambda _: post(
            "/v1/policies/untrained/learn",
            {"world": "bowling-sim", "attempts": 100_000, "batches": 100_000, "batch_size": 4096},
        ),
        job=True,
    )
    yield Case(
        "learn_policy",
        "in a long world",
        lambda s: post("/v1/policies/untrained/learn", {"world": s.world(), "attempts": 1000, "batches": 1000}),
        job=True,
    )
    yield Case(
        "evaluate_policy",
        "at random in a long world",
        lambda s: post("/v1/policies/random/evaluate", {"world": s.world(), "split": "train"}),
        job=True,
    )
    yield Case(
        "evaluate_policy",
        "a network on all tasks",
        lambda s: post(f"/v1/policies/{s.policy()}/evaluate", {"world": "bowling-sim", "split": "train"}),
        job=True,
    )
    for name, world, task, action in (
        ("bowling", "bowling-sim", "bowling:000", [0.1, 0.2, 0.3]),
        ("a long world", "", "custom:scene", [0.1, 0.2]),
    ):
        yield Case(
            "evaluate_policy",
            f"a ranking of 100,000 in {name}",
            lambda s, world=world, task=task, action=action: post(  # type: ignore[misc]
                "/v1/policies/ranked/evaluate",
                {"world": world or s.world(), "ranking": [{"task": task, "actions": [action] * 100_000}]},
            ),
            job=True,
        )


def learning_cases() -> Iterator[Case]:
    """Operations on measured trials, and those that design and plan."""
    for name, make in (
        ("14 MB of tracks", lambda: measured(14.5)),
        ("0.9 MB of tracks", lambda: measured(0.9)),
        ("0.3 MB of tracks", lambda: measured(0.3)),
        (
            "2000 overrides in settings",
            lambda: {"scene": overrides(), "trials": "trial,t,body,x,y\n0,0,b0,0,1\n0,1,b0,0,1\n"},
        ),
        (
            "32 compounds of 32 pieces",
            lambda: {
                "scene": compounds(32, 0, 4),
                "trials": "trial,t,body,x,y\n0,0,b0,0,0\n0,0.01,b0,0,1\n0,0.02,b0,0,1\n",
            },
        ),
    ):
        effects = {"effects": ["linear_drag", "wind"]}
        sets = {"sets": [["linear_drag"], ["wind"], ["quadratic_drag"], []], "draws": 10_000, "method": "mcmc"}
        yield Case("start_diagnosis", name, lambda _, make=make: post("/v1/diagnoses", make()), job=True)  # type: ignore[misc]
        yield Case("start_likelihood", name, lambda _, make=make: post("/v1/likelihoods", {**make(), **effects}), job=True)  # type: ignore[misc]
        yield Case("start_posterior", name, lambda _, make=make, sets=sets: post("/v1/posteriors", {**make(), **sets}), job=True)  # type: ignore[misc]
    yield Case(
        "start_diagnosis",
        "the trials of an estimation, 9 MB",
        lambda s: post("/v1/diagnoses", {"job": s.submitted()}),
        job=True,
    )
    yield Case(
        "start_posterior",
        "by SMC, 0.05 MB of tracks",
        lambda _: post(
            "/v1/posteriors",
            measured(0.05, sets=[["linear_drag"], ["wind"]], draws=100_000, method="smc", sample_discrepancy=True),
        ),
        job=True,
    )
    yield Case(
        "evaluate_likelihood",
        "4096 points",
        lambda s: post(f"/v1/likelihoods/{s.likelihood()['id']}/evaluate", s.points(4096)),
    )
    yield Case(
        "evaluate_likelihood",
        "4096 points as msgpack",
        lambda s: packed(f"/v1/likelihoods/{s.likelihood()['id']}/evaluate", s.points(4096)),
    )
    yield Case(
        "draw_starts", "4096", lambda s: post(f"/v1/likelihoods/{s.likelihood()['id']}/starts", {"count": 4096})
    )

    def explored(name: str, **fields: Any) -> Make:
        def make(_: Stage) -> Request:
            given = SCENES[name]()
            del given["goal"]
            return post("/v1/iplw", {"scene": given, "real": "ask_tell", "actions": 20, "samples": 100_000, **fields})

        return make

    for name in ("60 boxes, 800,000 steps", "32 compounds of 32 pieces", "2000 overrides in settings"):
        yield Case("start_iplw", name, explored(name), job=True)
    yield Case(
        "start_iplw",
        "100,000 samples, by information",
        lambda _: post(
            "/v1/iplw", {"task": "bowling", "samples": 100_000, "actions": 100, "rounds": 100, "strategy": "gradient"}
        ),
        job=True,
    )
    # Three of four proposals: with the last, the job would go on.
    rows = functools.partial(proposal_rows, 3)
    yield Case(
        "submit_trials",
        "16 MB as CSV",
        lambda s: Request("POST", f"/v1/iplw/{s.estimation('csv')}/trials?close=false", rows(16.0).encode(), CSV),
    )
    yield Case(
        "submit_trials",
        "9 MB as CSV",
        lambda s: Request(
            "POST", f"/v1/iplw/{s.estimation('csv')}/trials?close=false&replace=true", rows(9.0).encode(), CSV
        ),
    )
    yield Case(
        "submit_trials",
        "10^7 short rows",
        lambda s: Request(
            "POST", f"/v1/iplw/{s.estimation('csv')}/trials", b"trial,t,body,x,y\n" + b"1\n" * 8_000_000, CSV
        ),
    )
    row = "0.123"
    long = {
        "t": [i / 1e6 for i in range(150_000)],
        "proposal": 0,
        "bodies": {"ball": {a: [0.5] * 150_000 for a in ("x", "y", "vx", "vy")}},
    }
    yield Case(
        "submit_trials",
        "750,000 numbers",
        lambda s: post(f"/v1/iplw/{s.estimation('json')}/trials", {"trials": [long]}),
    )
    yield Case(
        "submit_trials",
        "10^6 failures",
        lambda s: post(f"/v1/iplw/{s.estimation('json')}/trials", wide('{"failed":[', row[0], "]}")),
    )
    design = {
        "task": "basketball",
        "question": "success",
        "candidates": 2000,
        "worlds": 256,
        "shortlist": 100,
        "copies": 8,
        "batch": 20,
    }
    yield Case("start_design", "success", lambda _: post("/v1/designs", design), job=True)
    yield Case("start_design", "latents", lambda _: post("/v1/designs", {**design, "question": "latents"}), job=True)
    plan = {"task": "bowling:000", "actions": 100_000, "draws": 1000, "exact": 100}
    yield Case("start_plan", "100,000 actions", lambda _: post("/v1/plans", plan), job=True)
    columns = {name: [0.5 + i / 1e6 for i in range(300_000)] for name in ("friction", "restitution", "density")}
    wide_posterior: Document = {"format": "iplw.posterior/2", "columns": columns, "effects": [], "discrepancy": None}
    yield Case(
        "start_plan",
        "a posterior of 900,000 numbers",
        lambda _: post("/v1/plans", {**plan, "posterior": wide_posterior}),
        job=True,
    )
    surface = {"task": "bowling", "points": 5000, "actions": 10_000}
    yield Case("find_surface", "5000 points", lambda _: post("/v1/surfaces", surface), job=True)
    yield Case(
        "find_surface",
        "5000 policies",
        lambda _: post("/v1/surfaces", {**surface, "route": "dqn", "actions": 1000}),
        job=True,
    )


def all_cases() -> list[Case]:
    kinds = (reading_cases, scene_cases, acting_cases, control_cases, policy_cases, learning_cases, deleting_cases)
    return [case for kind in kinds for case in kind()]


# What a request costs after its end.


@dataclass
class Busy:
    """Status of the answer; the server's processor time in the request, and after its end until it was idle, s."""

    status: int
    within: float
    after: float
    idle: bool
    said: str = ""


def given_up(s: Stage, request: Request, hang_up: bool, job: bool) -> Busy:
    """A request with a deadline, or whose client hangs up at that time."""
    whole = request.on_wire(s.token, None if hang_up else DEADLINE)
    before = s.running.processor_seconds()
    one = socket.create_connection(("127.0.0.1", s.running.http))
    end = time.perf_counter() + DEADLINE
    one.settimeout(10.0)
    with contextlib.suppress(BrokenPipeError, ConnectionResetError, TimeoutError):
        one.sendall(whole)
    begin, _, finished = read_until(one, end)
    mark = s.running.processor_seconds()
    if not (finished or hang_up):
        # The answer is due now; whoever streams one may take a little longer.
        begin, _, _ = read_until(one, time.perf_counter() + 1.0, begin)
    one.close()
    status = status_of(begin)
    if job and finished and status in (200, 202):
        # It was in time, and what computes now is the job.
        return Busy(status, mark - before, 0.0, True)
    _, idle = s.idle()
    after = s.running.processor_seconds() - mark
    if job and not idle and s.ask("GET", "/v1/jobs?results=false&state=running")[1].get("jobs"):
        begin = b'"detail":"yet its job was made, and runs"'
    return Busy(status, mark - before, after, idle, begin[:4000].decode(errors="replace"))


def cancelled(s: Stage, request: Request) -> Busy:
    """A job that is cancelled after a second."""
    before = s.running.processor_seconds()
    answer = s.send(request)
    if answer.status not in (200, 202):
        waited, idle = s.idle()
        return Busy(
            answer.status,
            s.running.processor_seconds() - before - waited,
            waited,
            idle,
            answer.begin[-200:].decode(errors="replace"),
        )
    job = json.loads(answer.begin.partition(b"\r\n\r\n")[2])["id"] if answer.finished else None
    time.sleep(1.0)
    assert job, answer.begin[-200:]
    status, _ = s.ask("DELETE", f"/v1/jobs/{job}")
    mark = s.running.processor_seconds()
    waited, idle = s.idle()
    return Busy(status, mark - before, waited, idle)


def operations_of(s: Stage) -> set[str]:
    paths = s.ask("GET", "/openapi.json")[1]["paths"].values()
    return {
        one["operationId"]
        for path in paths
        for one in path.values()
        if isinstance(one, dict) and "operationId" in one
    }


def deadline(binary: str, only: str) -> bool:
    """Prints the table; whether all is as wanted."""
    cases = [case for case in all_cases() if only in f"{case.operation} {case.what}"]
    print(
        f"| operation | request | way | status | processor time in it, s | after its end, s (wanted {BUSY_SECONDS}) |"
    )
    print("|---|---|---|---|---|---|", flush=True)
    good, at, number = True, contextlib.ExitStack(), 0
    with at:
        s = renew(at, binary)
        without = operations_of(s) - {case.operation for case in all_cases()}
        for name in sorted(without):
            print(f"| {name} | no case | | | | FAILS |")
            good = False
        while number < len(cases):
            case = cases[number]
            number += 1
            for way in ("deadline", "hang up") + (("cancel",) if case.job else ()):
                try:
                    request = case.make(s)
                    s.idle()
                    found = (
                        cancelled(s, request) if way == "cancel" else given_up(s, request, way == "hang up", case.job)
                    )
                except (AssertionError, OSError, LookupError, TypeError, ValueError, http.client.HTTPException) as e:
                    print(
                        f"| {case.operation} | {case.what} | {way} | not measured: {type(e).__name__} {str(e)[:150]} | | FAILS |",
                        flush=True,
                    )
                    good = False
                    s = renew(at, binary)
                    continue
                fails = found.after > BUSY_SECONDS or not found.idle
                good &= not fails
                shown = f"{found.after:.2f}" if found.idle else f"over {found.after:.1f}, still busy"
                refused = (
                    ""
                    if (found.status in (0, 200, 201, 202, 204, 503) and "yet" not in found.said)
                    or "detail" not in found.said
                    else f" {said(found.said)}"
                )
                print(
                    f"| {case.operation} | {case.what} | {way} | {found.status or ''}{refused} | {found.within:.2f} | "
                    f"{shown}{' FAILS' if fails else ''} |",
                    flush=True,
                )
                if not found.idle:
                    s = renew(at, binary)
                elif case.job:
                    s.forget_jobs()
                    s.made = {k: v for k, v in s.made.items() if not k.startswith("estimation") and k != "submitted"}
                    if not s.idle()[1]:
                        s = renew(at, binary)
    return good


def said(text: str) -> str:
    """The detail of a problem."""
    return text.partition('"detail":"')[2].partition('","')[0][:80].replace("|", "/")


def renew(at: contextlib.ExitStack, binary: str) -> Stage:
    at.close()
    # The cases make many worlds, one after the other.
    return at.enter_context(stage(binary, worlds=20_000, owner_worlds=20_000))


# Memory.


def megabytes_of(pid: int, field: str) -> float:
    line = next(line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith(field))
    return int(line.split()[1]) / 1000


def one_request(make: Make, watched: float = 0.0) -> Callable[[Stage], str]:
    """Sends a request and, if it starts a job, watches that for some time; says what became of it."""

    def attack(s: Stage) -> str:
        answer = s.send(make(s))
        if answer.status != 202:
            return f"{answer.status} {said(answer.begin.decode(errors='replace'))}"
        job = json.loads(answer.begin.partition(b"\r\n\r\n")[2])["id"]
        until, state = time.perf_counter() + watched, ""
        while time.perf_counter() < until:
            row = s.ask("GET", f"/v1/jobs?results=false&limit=1&order=newest")[1]["jobs"][0]
            state = f"{row['state']} {row['progress']['stage'][:40]}"
            if row["state"] not in ("queued", "running"):
                if row["state"] == "failed":
                    state += f" {row['error']['detail'][:80]}"
                break
            time.sleep(0.2)
        s.ask("DELETE", f"/v1/jobs/{job}")
        return f"202 {state}"

    return attack


def many_at_once(make: Make, count: int, watched: float = 0.0) -> Callable[[Stage], str]:
    """The same request over several connections at once."""

    def attack(s: Stage) -> str:
        whole = make(s).on_wire(s.token, None)
        pids = []
        for _ in range(count):
            pid = os.fork()
            if pid == 0:
                code = 0
                try:
                    with socket.create_connection(("127.0.0.1", s.running.http)) as one:
                        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                            one.sendall(whole)
                        code = status_of(read_until(one, time.perf_counter() + 40.0)[0]) // 100
                finally:
                    os._exit(code)
            pids.append(pid)
        time.sleep(watched)
        statuses = sorted(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) for pid in pids)
        return "answers " + ", ".join(f"{statuses.count(n)} of {n}xx" for n in sorted(set(statuses)))

    return attack


def named_worlds(s: Stage) -> str:
    told = set()
    for i in range(30):
        answer = s.send(post("/v1/worlds", {"scene": {**scene([BALL], [FLOOR]), "name": f"{i}" + "n" * 15_000_000}}))
        told.add(f"{answer.status} {said(answer.begin.decode(errors='replace'))[:16]}")
    return "; ".join(sorted(told))


BODY_SECONDS = 6.0


def unfinished(s: Stage) -> str:
    """Messages over ZeroMQ that never end, by a token that may only read."""
    row = s.ask("POST", "/v1/tokens", {"name": "reader", "scope": "read"})[1]
    token = str(row.get("token") or row.get("secret"))
    assert s.running.zmq is not None
    ones, part = [], bytes(1 << 20)
    for _ in range(60):
        one = asking.dealer(s.running.zmq, token)
        one.settimeout(5.0)
        with contextlib.suppress(OSError):
            one.sendall(b"\x02" + struct.pack(">Q", 16 * (1 << 20) - 64))
            for _ in range(15):
                one.sendall(part)
        ones.append(one)
    held = megabytes_of(s.running.pid, "VmRSS")
    time.sleep(BODY_SECONDS + 2.0)
    still = 0
    for one in ones:
        one.settimeout(0.2)
        try:
            while one.recv(65536):
                pass
        except TimeoutError:
            still += 1
        except OSError:
            pass
        one.close()
    assert still == 0, f"{still} of 60 connections are open after body_seconds"
    return f"resident with all: {held:.0f} MB; open after `body_seconds`: {still}"


def memory_cases() -> Iterator[tuple[str, Callable[[Stage], str]]]:
    for size in (0.3, 0.9, 1, 4, 9, 10, 15):
        effects = {"effects": ["linear_drag", "wind"]}
        sets = {"sets": [["linear_drag"], ["wind"]]}
        for name, path, more in (
            ("diagnosis", "/v1/diagnoses", {}),
            ("posterior", "/v1/posteriors", sets),
            ("likelihood", "/v1/likelihoods", effects),
        ):
            yield (
                f"{name} of {size} MB of tracks",
                one_request(lambda _, path=path, size=size, more=more: post(path, measured(size, **more)), 15.0),  # type: ignore[misc]
            )

        def estimated(s: Stage, size: float = size) -> str:
            job = s.estimation("memory")
            answer = s.send(Request("POST", f"/v1/iplw/{job}/trials", proposal_rows(4, size).encode(), CSV))
            until = time.perf_counter() + 15.0
            row: Document = {}
            while time.perf_counter() < until:
                row = s.ask("GET", "/v1/jobs?results=false&limit=1&order=newest")[1]["jobs"][0]
                if row["state"] not in ("queued", "running"):
                    break
                time.sleep(0.2)
            return f"{answer.status} {said(answer.begin.decode(errors='replace'))} {row.get('state')}"

        yield f"estimation, {size} MB of trials", estimated
    million = "".join(f"0,{i / 1e6:.6f},0,1\n" for i in range(900_000))
    yield (
        "diagnosis of 9*10^5 rows in one trial",
        one_request(
            lambda _: packed(
                "/v1/diagnoses", {"ball": THROWN, "reading": READING, "trials": "trial,t,x,y\n" + million}
            ),
            15.0,
        ),
    )
    for what, row in (
        ("2.7*10^6 rows of 6 bytes", "1,1,1\n"),
        ("8*10^6 rows of 2 bytes", "1\n"),
        ("1.6*10^7 empty rows", "\n"),
    ):
        text = "t,x,y\n" + row * (16_000_000 // len(row))
        yield (
            f"diagnosis of {what}",
            one_request(lambda _, text=text: packed("/v1/diagnoses", {"ball": THROWN, "reading": READING, "trials": text}), 15.0),  # type: ignore[misc]
        )
        raw = ("trial,t,body,x,y\n" + row * (16_000_000 // len(row))).encode()
        yield (
            f"submission of {what}",
            one_request(lambda s, raw=raw: Request("POST", f"/v1/iplw/{s.estimation('memory')}/trials", raw, CSV)),  # type: ignore[misc]
        )
    commas = ("trial,t,body,x,y\n" + "," * 15_900_000 + "\n").encode()
    yield "submission of a row of 1.6*10^7 cells", one_request(
        lambda s: Request("POST", f"/v1/iplw/{s.estimation('memory')}/trials", commas, CSV)
    )
    yield "30 worlds with names of 15 MB", named_worlds
    for name in SCENES:
        yield f"world of {name}", one_request(lambda _, name=name: post("/v1/worlds", {"scene": SCENES[name]()}))  # type: ignore[misc]
    yield "2000 worlds of 16 compounds", one_request(
        lambda _: post("/v1/batch/worlds", {"scene": compounds(16, 0, 8), "count": 2000})
    )
    jobs: list[tuple[str, str, Document]] = [
        ("surface of 50,000 actions", "/v1/surfaces", {"task": "bowling", "points": 5000, "actions": 50_000}),
        ("surface of policies", "/v1/surfaces", {"task": "bowling", "points": 5000, "actions": 3_000, "route": "dqn"}),
        ("plan of 100,000 actions", "/v1/plans", {"task": "bowling:000", "actions": 100_000, "draws": 1000}),
        ("training", "/v1/policies", {"task": "bowling", "batches": 100_000, "batch_size": 4096}),
        (
            "learning from 100,000 attempts",
            "/v1/policies/untrained/learn",
            {"world": "bowling-sim", "attempts": 100_000, "batches": 100_000, "batch_size": 4096},
        ),
        ("estimation of 100,000 samples", "/v1/iplw", {"task": "bowling", "samples": 100_000, "actions": 100}),
        (
            "ranking of 100,000 actions",
            "/v1/policies/ranked/evaluate",
            {"world": "bowling-sim", "ranking": [{"task": "bowling:000", "actions": [[0.1, 0.2, 0.3]] * 100_000}]},
        ),
        (
            "design",
            "/v1/designs",
            {"task": "basketball", "question": "success", "candidates": 2000, "worlds": 256, "shortlist": 100},
        ),
    ]
    for what, path, job in jobs:
        yield f"job: {what}", one_request(lambda _, path=path, job=job: post(path, job), 15.0)  # type: ignore[misc]
    yield "60 unfinished messages of 16 MB by a reader", unfinished
    numbers = wide('{"task":"bowling:000","actions":[[', "0.5", "]]}")
    lists = wide('{"task":"bowling:000","actions":[', "[]", "]}", 200_000)
    objects = wide('{"task":"bowling:000","actions":[', "{}", "]}", 61_000)
    for what, body in (("10^6 numbers", numbers), ("200,000 lists", lists), ("61,000 objects", objects)):
        yield f"JSON of {what}", one_request(lambda _, body=body: post("/v1/place", body))  # type: ignore[misc]
        yield f"JSON of {what}, 16 at once", many_at_once(lambda _, body=body: post("/v1/place", body), 16)  # type: ignore[misc]
    longer = wide('{"task":"bowling:000","actions":[[', "0.1234567890123", "]]}")
    yield "JSON of 16 MB, 8 at once", many_at_once(lambda _: post("/v1/place", longer), 8)
    yield "diagnoses of 10 MB, 8 at once", many_at_once(lambda _: post("/v1/diagnoses", measured(10)), 8)
    yield "diagnoses of 0.9 MB, 8 at once", many_at_once(lambda _: post("/v1/diagnoses", measured(0.9)), 8, 20.0)
    samples = {"scene": boxes(steps=65_000, observe_every=1), "action": [0.5, 0.5]}
    yield "simulation of 4*10^6 samples", one_request(lambda _: post("/v1/simulate", samples))
    yield "8 of them at once", many_at_once(lambda _: post("/v1/simulate", samples), 8)


def memory(binary: str, only: str) -> bool:
    print(f"| request or job | answer | peak above idle, MB (wanted {MEGABYTES:.0f}) |")
    print("|---|---|---|", flush=True)
    good = True
    for what, attack in memory_cases():
        if only not in what:
            continue
        with stage(binary, body_seconds=BODY_SECONDS) if "unfinished" in what else stage(binary) as s:
            s.ask("GET", "/v1/limits")
            before = megabytes_of(s.running.pid, "VmRSS")
            try:
                told, failed = attack(s), False
            except (AssertionError, OSError, LookupError, TypeError, ValueError, http.client.HTTPException) as e:
                told, failed = f"{type(e).__name__} {str(e)[:150]}", True
            peak = megabytes_of(s.running.pid, "VmHWM") - before if s.running.process.poll() is None else math.inf
        failed |= peak > MEGABYTES
        good &= not failed
        print(f"| {what} | {told} | {peak:.0f}{' FAILS' if failed else ''} |", flush=True)
    return good


# Floods.


def keep_sending(port: int, token: str, make: Callable[[int], Request]) -> None:
    """Sends requests over one connection for ever, each after the previous answer."""
    count = 0
    while True:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)) as one:
            while True:
                one.sendall(make(count).on_wire(token, None))
                count += 1
                begin, _, finished = read_until(one, time.perf_counter() + 60.0)
                if not finished or b"connection: close" in begin[:1000].lower():
                    break


def send_bodies(port: int, _: int, token: str, prepared: bytes) -> None:
    request = post("/v1/place", prepared)
    keep_sending(port, token, lambda _: request)


def send_weights(port: int, _: int, token: str, prepared: bytes) -> None:
    name = os.getpid()
    keep_sending(port, token, lambda n: Request("PUT", f"/v1/policies/f{name}-{n % 50}/weights", prepared, BYTES))


def send_jobs(port: int, _: int, token: str, prepared: bytes) -> None:
    connection, head = http.client.HTTPConnection("127.0.0.1", port), {"Authorization": f"Bearer {token}"}
    made: list[str] = []
    while True:
        status, row = ask(connection, "POST", "/v1/plans", json.loads(prepared), **head)
        if status == 202:
            made.append(str(row["id"]))
        elif made:
            ask(connection, "DELETE", f"/v1/jobs/{made.pop(0)}", **head)


def send_worlds(port: int, _: int, token: str, prepared: bytes) -> None:
    connection, head = http.client.HTTPConnection("127.0.0.1", port), {"Authorization": f"Bearer {token}"}
    while True:
        status, made = ask(connection, "POST", "/v1/batch/worlds", json.loads(prepared), **head)
        if status != 201:
            rows = ask(connection, "GET", "/v1/worlds?limit=1000", **head)[1]["worlds"]
            assert isinstance(rows, list)
            ids = [row["id"] for row in rows if row["owner"]]
            ask(connection, "DELETE", "/v1/batch/worlds", {"worlds": ids}, **head)


def send_unfinished(_: int, port: int, token: str, prepared: bytes) -> None:
    while True:
        with contextlib.suppress(OSError, AssertionError), asking.dealer(port, token) as one:
            one.settimeout(2.0)
            one.sendall(b"\x02" + struct.pack(">Q", 16 * len(prepared)))
            for _ in range(15):
                one.sendall(prepared)
            time.sleep(0.2)


def compute_beside(_: int, __: int, ___: str, ____: bytes) -> None:
    """For comparison: a process of its own that keeps a core busy, and sends nothing."""
    while True:
        sum(range(10_000))


Flood = Callable[[int, int, str, bytes], None]


def gently(flood: Flood, http_port: int, zmq_port: int, token: str, prepared: bytes) -> None:
    """The flood's own work should not compete with what is measured."""
    if flood is not compute_beside:
        os.nice(19)
    flood(http_port, zmq_port, token, prepared)


@contextlib.contextmanager
def flooding(s: Server, flood: Flood, token: str, prepared: bytes, connections: int) -> Iterator[None]:
    assert s.zmq is not None
    arguments = (flood, s.http, s.zmq, token, prepared)
    running = [multiprocessing.Process(target=gently, args=arguments, daemon=True) for _ in range(connections)]
    for one in running:
        one.start()
    try:
        time.sleep(1.0)
        yield
    finally:
        for one in running:
            one.kill()
            one.join()


def light_p99(running: Server, token: str, count: int = 200) -> float:
    """99th percentile of the duration of a reset with a step, s."""
    connection, head = running.connect(), {"Authorization": f"Bearer {token}"}
    times = []
    for _ in range(count):
        begun = time.perf_counter()
        ask(connection, "POST", "/v1/worlds/bowling-sim/reset", {"seed": 1}, **head)
        status, told = ask(connection, "POST", "/v1/worlds/bowling-sim/step", {"action": [0.5, 0.8, 0.3]}, **head)
        times.append(time.perf_counter() - begun)
        assert status == 200, told
    connection.close()
    return statistics.quantiles(times, n=100)[98]


def floods(binary: str, only: str) -> bool:
    print(
        f"| one client floods with | p99 of another's step, quiet, ms | flooded, ms | ratio, median of 5 (wanted {P99_RATIO:.0f}) |"
    )
    print("|---|---|---|---|", flush=True)
    good = True
    with stage(binary) as s:
        weights = s.weights()
    plan = json.dumps({"task": "bowling:000", "actions": 100_000, "draws": 1000}).encode()
    numbers = wide('{"task":"bowling:000","actions":[[', "0.123456", "]]}", 220_000)
    kinds: list[tuple[str, Flood, bytes, int]] = [
        ("bodies of 2 MB over 16 connections", send_bodies, numbers, 16),
        ("jobs", send_jobs, plan, 1),
        ("worlds up to its quota", send_worlds, json.dumps({"task": "bowling", "count": 512}).encode(), 1),
        ("unfinished messages over 16 connections", send_unfinished, bytes(1 << 20), 16),
        ("weights of 1 MB over 4 connections", send_weights, weights, 4),
        ("nothing, but other processes keep all cores busy", compute_beside, b"", os.cpu_count() or 1),
    ]
    for what, flood, prepared, connections in kinds:
        if only not in what:
            continue
        with tempfile.TemporaryDirectory() as place:
            first, second = (asking.new_token(binary, place, name) for name in ("ann", "bob"))
            with server(binary, "--data-dir", place, zmq=True) as running:
                s = Stage(binary, running, first)
                light_p99(running, second, 50)
                pairs = []
                for _ in range(5):
                    s.idle(5.0)
                    quiet = light_p99(running, second)
                    with flooding(running, flood, first, prepared, connections):
                        pairs.append((quiet, light_p99(running, second)))
                    if flood is send_jobs:
                        s.forget_jobs()
        ratio = statistics.median(flooded / quiet for quiet, flooded in pairs)
        quiet, flooded = (1000 * statistics.median(each) for each in zip(*pairs))
        fails = ratio > P99_RATIO and flood is not compute_beside
        good &= not fails
        print(f"| {what} | {quiet:.1f} | {flooded:.1f} | {ratio:.2f}{' FAILS' if fails else ''} |", flush=True)
    if only in "job of another client":
        seconds = job_start(binary)
        fails = seconds > START_SECONDS
        good &= not fails
        print(
            f"a job of another client begins {seconds:.1f} s after it was queued (wanted {START_SECONDS:.0f} s){' FAILS' if fails else ''}"
        )
    return good


def job_start(binary: str) -> float:
    """Seconds until a client's job runs while another's endless jobs have all places and its queue is full."""
    endless = {"task": "bowling:000", "actions": 100_000, "draws": 1000, "exact": 100}
    with tempfile.TemporaryDirectory() as place:
        first, second = (asking.new_token(binary, place, name) for name in ("ann", "bob"))
        with server(binary, "--data-dir", place) as running:
            ann, bob = Stage(binary, running, first), Stage(binary, running, second)
            seed = 0
            while ann.ask("POST", "/v1/plans", {**endless, "seed": seed})[0] == 202:
                seed += 1
            time.sleep(1.0)
            begun = time.perf_counter()
            status, made = bob.ask("POST", "/v1/plans", endless)
            assert status == 202, made
            while time.perf_counter() - begun < 2 * START_SECONDS:
                if bob.ask("GET", f"/v1/jobs/{made['id']}")[1]["state"] == "running":
                    break
                time.sleep(0.02)
            taken = time.perf_counter() - begun
            ann.forget_jobs()
            bob.forget_jobs()
            return taken


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--binary", default="target/release/iplw")
    parser.add_argument("--only", choices=["deadline", "memory", "floods"], action="append")
    parser.add_argument("--case", default="", help="only cases whose name contains this")
    arguments = parser.parse_args()
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    # Servers are stopped when this is.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(2))
    tables = {"deadline": deadline, "memory": memory, "floods": floods}
    results = [tables[name](arguments.binary, arguments.case) for name in arguments.only or list(tables)]
    sys.exit(0 if all(results) else 1)


if __name__ == "__main__":
    main()
