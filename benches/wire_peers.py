"""Trivial environments in other frameworks, each with its own server and client, for comparison in `wire.py`.

    python wire_peers.py serve openenv PORT
    python wire_peers.py drive openenv PORT STEPS

The environment takes three numbers and gives six; its step adds them up. `drive` prints the median of STEPS single
steps, us, as JSON.

| name | server | client |
|---|---|---|
| `openenv` | `openenv-core`: FastAPI and uvicorn, a WebSocket a session | its synchronous client |
| `dm_env_rpc` | gRPC, a bidirectional stream a session | its `dm_env` adaptor |
| `flask` | Flask in the manner of gym-http-api: `POST /v1/envs/ID/step/`, JSON, threaded | `requests.Session` |
| `flask_urllib3` | the same over HTTP/1.1 connections kept alive | `urllib3` |
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

ACTION = [0.5, 0.5, 0.2]


def answer(action: Any) -> list[float]:
    total = float(sum(action))
    return [total, total, total, total, total, total]


def serve_openenv(port: int) -> None:
    import uvicorn
    from openenv.core.env_server.http_server import create_fastapi_app
    from openenv.core.env_server.interfaces import Environment
    from openenv.core.env_server.types import Action, Observation, State

    class Place(Action):
        values: list[float]

    class Features(Observation):
        features: list[float]

    class Trivial(Environment):  # type: ignore[misc]
        def reset(self, *_: Any, **__: Any) -> Features:
            return Features(features=[0.0] * 6)

        def step(self, action: Place, *_: Any, **__: Any) -> Features:
            return Features(features=answer(action.values), reward=0.0, done=False)

        @property
        def state(self) -> State:
            return State()

    app = create_fastapi_app(Trivial, Place, Features)
    uvicorn.run(app, host="127.0.0.1", port=port, log_level="error")


def drive_openenv(port: int) -> Callable[[], Any]:
    from openenv.core import GenericEnvClient

    env = GenericEnvClient(base_url=f"http://127.0.0.1:{port}").sync()
    env.__enter__()
    env.reset()
    return lambda: env.step({"values": ACTION})


def serve_dm_env_rpc(port: int) -> None:
    from concurrent import futures

    import grpc
    from dm_env_rpc.v1 import dm_env_rpc_pb2 as pb
    from dm_env_rpc.v1 import dm_env_rpc_pb2_grpc, tensor_utils

    def spec(name: str, size: int) -> Any:
        return pb.TensorSpec(name=name, dtype=pb.DOUBLE, shape=[size])

    specs = pb.ActionObservationSpecs(
        actions={1: spec("action", 3)},
        observations={1: spec("features", 6), 2: pb.TensorSpec(name="reward", dtype=pb.DOUBLE)},
    )

    class Trivial(dm_env_rpc_pb2_grpc.EnvironmentServicer):  # type: ignore[misc]
        def Process(self, requests: Any, _: Any) -> Any:
            action = [0.0]
            for request in requests:
                kind = request.WhichOneof("payload")
                reply = pb.EnvironmentResponse()
                if kind == "create_world":
                    reply.create_world.world_name = "trivial"
                elif kind == "join_world":
                    reply.join_world.specs.CopyFrom(specs)
                elif kind == "step":
                    if 1 in request.step.actions:
                        action = tensor_utils.unpack_tensor(request.step.actions[1])
                    reply.step.state = pb.RUNNING
                    made = {1: np.asarray(answer(action)), 2: np.float64(0.0)}
                    for number in request.step.requested_observations:
                        reply.step.observations[number].CopyFrom(tensor_utils.pack_tensor(made[number]))
                elif kind == "reset":
                    reply.reset.specs.CopyFrom(specs)
                else:
                    getattr(reply, kind).SetInParent()
                yield reply

    server = grpc.server(futures.ThreadPoolExecutor(4))
    dm_env_rpc_pb2_grpc.add_EnvironmentServicer_to_server(Trivial(), server)
    server.add_insecure_port(f"127.0.0.1:{port}")
    server.start()
    server.wait_for_termination()


def drive_dm_env_rpc(port: int) -> Callable[[], Any]:
    from dm_env_rpc.v1 import connection, dm_env_adaptor

    line = connection.create_secure_channel_and_connect(f"127.0.0.1:{port}")
    env, _ = dm_env_adaptor.create_and_join_world(line, {}, {})
    env.reset()
    action = {"action": np.asarray(ACTION)}
    return lambda: env.step(action)


def serve_flask(port: int, kept: bool = False) -> None:
    import logging

    from flask import Flask, jsonify, request
    from werkzeug.serving import WSGIRequestHandler

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    if kept:
        WSGIRequestHandler.protocol_version = "HTTP/1.1"
    app = Flask("trivial")

    @app.route("/v1/envs/<instance>/step/", methods=["POST"])
    def step(instance: str) -> Any:
        action = request.get_json()["action"]
        return jsonify(observation=answer(action), reward=0.0, done=False, info={})

    app.run("127.0.0.1", port, threaded=True)


def drive_flask(port: int) -> Callable[[], Any]:
    import requests

    session = requests.Session()
    url = f"http://127.0.0.1:{port}/v1/envs/a/step/"

    def step() -> Any:
        got = session.post(url, json={"action": ACTION, "render": False})
        got.raise_for_status()
        return got.json()

    return step


def drive_flask_urllib3(port: int) -> Callable[[], Any]:
    import urllib3

    pool = urllib3.connection_from_url(f"http://127.0.0.1:{port}")
    headers = {"Content-Type": "application/json"}

    def step() -> Any:
        body = json.dumps({"action": ACTION})
        return json.loads(pool.urlopen("POST", "/v1/envs/a/step/", body=body, headers=headers).data)

    return step


SERVE: dict[str, Callable[[int], None]] = {
    "openenv": serve_openenv,
    "dm_env_rpc": serve_dm_env_rpc,
    "flask": serve_flask,
    "flask_urllib3": lambda port: serve_flask(port, kept=True),
}
DRIVE: dict[str, Callable[[int], Callable[[], Any]]] = {
    "openenv": drive_openenv,
    "dm_env_rpc": drive_dm_env_rpc,
    "flask": drive_flask,
    "flask_urllib3": drive_flask_urllib3,
}


def main() -> None:
    what, name, port = sys.argv[1], sys.argv[2], int(sys.argv[3])
    if what == "serve":
        SERVE[name](port)
        return
    steps = int(sys.argv[4])
    step = DRIVE[name](port)
    for _ in range(steps // 10):
        step()
    took = []
    for _ in range(steps):
        start = time.perf_counter()
        step()
        took.append(time.perf_counter() - start)
    print(json.dumps({"us": 1e6 * statistics.median(took)}), flush=True)
    # Some frameworks leave running threads.
    import os

    os._exit(0)


if __name__ == "__main__":
    main()
