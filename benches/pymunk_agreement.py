"""Distance between an engine's rollouts and Pymunk's on the same scenes, with Pymunk's defaults.

    python benches/pymunk_agreement.py target/release/iplw SCENES.jsonl [lanes|rapier] [SLOP]

Prints, for 1 to 4 s: the share of scenes in which every body has stayed within 1 cm, and quantiles of the maximum
distance.
"""

import json
import math
import subprocess
import sys

import pymunk_scene

CLOSE = 0.01


def main():
    binary, path = sys.argv[1:3]
    engine = sys.argv[3] if len(sys.argv) > 3 else "lanes"
    slop = float(sys.argv[4]) if len(sys.argv) > 4 else None
    with open(path) as lines:
        scenes = [json.loads(line) for line in lines]
    worst = {1: [], 2: [], 3: [], 4: []}
    for scene in scenes:
        # Ten comparisons per second, so that a rollout that diverges temporarily does not count as close.
        scene["observe_every"] = max(1, round(0.1 / scene["time_step"]))
        scene["stop"] = False
    lines = "\n".join(map(json.dumps, scenes))
    ran = subprocess.run([binary, "rollout", "--engine", engine], input=lines, capture_output=True, text=True, check=True)
    for scene, line in zip(scenes, ran.stdout.splitlines(), strict=True):
        compare(scene, json.loads(line), slop, worst)
    for second, distances in worst.items():
        if distances:
            distances.sort()
            n = len(distances)
            share = sum(d < CLOSE for d in distances) / n
            print(f"{second} s: {share:6.1%} of {n} within 1 cm; median {distances[n // 2]:.2e} m, "
                  f"90 % {distances[int(0.9 * n)]:.2e} m, worst {distances[-1]:.2e} m")


def compare(scene, ours, slop, worst):
    space, bodies = pymunk_scene.build(scene, slop)
    names = [body["name"] for body in scene["bodies"]]
    distance, done = 0.0, 0
    for i, time in enumerate(ours["t"]):
        step = round(time / scene["time_step"])
        for _ in range(step - done):
            space.step(scene["time_step"])
        done = step
        for name, body in zip(names, bodies):
            track = ours["bodies"][name]
            distance = max(distance, math.hypot(track["x"][i] - body.position.x, track["y"][i] - body.position.y))
        for second in worst:
            if abs(time - second) < scene["time_step"] / 2:
                worst[second].append(distance)


if __name__ == "__main__":
    main()
