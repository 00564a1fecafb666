"""Rollouts per second of Pymunk and, if installed, Box2D, on scenes from a file of JSON lines.

    python benches/pymunk_bench.py SCENES.jsonl

Times stepping from Python with states read every `observe_every` steps, world building included, as a user would
write it, in processor time, as `engines.rs` does. One JSON line for each engine.
"""

import json
import statistics
import sys
import time

import pymunk_scene

REPETITIONS = 5


def pymunk_rollout(scene):
    space, bodies = pymunk_scene.build(scene)
    dt, every = scene["time_step"], scene["observe_every"]
    seen = []
    for step in range(1, scene["steps"] + 1):
        space.step(dt)
        if step % every == 0:
            seen.append([(*b.position, b.angle) for b in bodies])
    return seen


def box2d_rollout(scene):
    import Box2D

    world = Box2D.b2World(gravity=tuple(scene["gravity"]), doSleep=False)
    for fixed in scene["statics"]:
        shape = fixed["shape"]
        body = world.CreateStaticBody(position=tuple(fixed["position"]), angle=fixed.get("angle", 0.0))
        box = Box2D.b2PolygonShape(box=(shape["half_width"], shape["half_height"]))
        body.CreateFixture(shape=box, friction=fixed["friction"], restitution=fixed["restitution"])
    bodies = []
    for own in scene["bodies"]:
        body = world.CreateDynamicBody(position=tuple(own["position"]))
        body.CreateFixture(shape=Box2D.b2CircleShape(radius=own["shape"]["radius"]), density=own["density"],
                           friction=own["friction"], restitution=own["restitution"])
        bodies.append(body)
    dt, every = scene["time_step"], scene["observe_every"]
    seen = []
    for step in range(1, scene["steps"] + 1):
        world.Step(dt, 10, 10)
        if step % every == 0:
            seen.append([(*b.position, b.angle) for b in bodies])
    return seen


def measure(name, rollout, scenes):
    seconds = []
    for _ in range(REPETITIONS):
        start = time.process_time()
        for scene in scenes:
            rollout(scene)
        seconds.append(time.process_time() - start)
    steps = sum(scene["steps"] for scene in scenes)
    middle = statistics.median(seconds)
    print(json.dumps({"engine": name, "level": "python", "rollouts_per_s": len(scenes) / middle,
                      "rollouts_per_s_range": [len(scenes) / max(seconds), len(scenes) / min(seconds)],
                      "us_per_step": 1e6 * middle / steps}), flush=True)


def main():
    with open(sys.argv[1]) as lines:
        scenes = [json.loads(line) for line in lines]
    measure("pymunk", pymunk_rollout, scenes)
    try:
        import Box2D  # noqa: F401
    except ImportError:
        print("Box2D is not installed: skipped", file=sys.stderr)
    else:
        measure("box2d", box2d_rollout, scenes)


if __name__ == "__main__":
    main()
