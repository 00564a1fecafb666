"""Writes predictable scenes of tumbling boxes, polygons, capsules, an L and discs as JSON lines.

    python benches/polygon_scenes.py COUNT SEED [SECONDS] > scenes.jsonl

A scene is predictable if Pymunk, started with a perturbation of 1 um, stays within 1 mm for SECONDS (2); in chaotic scenes engines
cannot agree.
"""

import json
import math
import random
import sys

import pymunk_scene

ASIDE, STAYS = 1e-6, 1e-3


def scene(draw, index):
    def shape(kind):
        if kind == "box":
            return {"type": "box", "half_width": draw.uniform(0.3, 1.0), "half_height": draw.uniform(0.3, 0.8)}
        if kind == "polygon":
            n = draw.choice([3, 5, 6])
            angles = [2 * math.pi * (i + draw.uniform(-0.25, 0.25)) / n for i in range(n)]
            radius = draw.uniform(0.5, 1.0)
            return {"type": "polygon", "vertices": [[radius * math.cos(a), radius * math.sin(a)] for a in angles]}
        if kind == "segment":
            half = draw.uniform(0.4, 1.2)
            return {"type": "segment", "from": [-half, 0.0], "to": [half, 0.0], "radius": draw.uniform(0.1, 0.25)}
        if kind == "compound":
            long = draw.uniform(0.6, 1.0)
            return {"type": "compound", "pieces": [
                {"type": "box", "half_width": long, "half_height": 0.2},
                {"type": "box", "half_width": 0.2, "half_height": long, "position": [long - 0.2, long - 0.2]},
            ]}
        return {"type": "disc", "radius": draw.uniform(0.3, 0.8)}

    kinds = ["box", "polygon", "segment", "compound", "disc", "box"]
    chosen = [draw.choice(kinds[:4])] + [draw.choice(kinds) for _ in range(draw.randint(0, 3))]
    bodies = [{
        "name": f"b{i}", "shape": shape(kind), "density": draw.uniform(0.3, 2.0), "friction": draw.uniform(0.2, 0.9),
        "restitution": draw.uniform(0.0, 0.6), "position": [-4.5 + 3.0 * i, draw.uniform(1.8, 3.5)],
        "angle": draw.uniform(-1.5, 1.5), "velocity": [draw.uniform(-2, 2), draw.uniform(-1, 2)],
        "angular_velocity": draw.uniform(-3, 3),
    } for i, kind in enumerate(chosen)]
    fixed = lambda name, shape, **where: {"name": name, "shape": shape, "friction": 0.8, "restitution": 0.7, **where}
    wall = lambda w, h: {"type": "box", "half_width": w, "half_height": h}
    statics = [
        fixed("floor", wall(9.0, 0.5), position=[0.0, -0.5]),
        fixed("left", wall(0.5, 6.0), position=[-8.5, 5.0]),
        fixed("right", wall(0.5, 6.0), position=[8.5, 5.0]),
        fixed("ramp", {"type": "polygon", "vertices": [[3.0, 0.0], [8.0, 0.0], [8.0, 2.0]]}),
    ]
    return {"format": "iplw.scene/1", "name": f"polygons-{index}", "gravity": [0.0, -9.8], "bodies": bodies,
            "statics": statics, "damping": draw.choice([1.0, 0.8]), "time_step": 1 / 240, "steps": 960,
            "observe_every": 24}


def predictable(own, seconds):
    aside = json.loads(json.dumps(own))
    for body in aside["bodies"]:
        body["position"][0] += ASIDE
    (one, bodies), (other, moved) = pymunk_scene.build(own), pymunk_scene.build(aside)
    for _ in range(round(seconds / own["time_step"])):
        one.step(own["time_step"])
        other.step(own["time_step"])
        if any(a.position.get_distance(b.position) > STAYS for a, b in zip(bodies, moved)):
            return False
    return True


def main():
    count, seed = int(sys.argv[1]), int(sys.argv[2])
    seconds = float(sys.argv[3]) if len(sys.argv) > 3 else 2.0
    draw, kept, tried = random.Random(seed), 0, 0
    while kept < count:
        own = scene(draw, tried)
        tried += 1
        if predictable(own, seconds):
            print(json.dumps(own))
            kept += 1
    print(f"{kept} of {tried} scenes are predictable for {seconds:g} s", file=sys.stderr)


if __name__ == "__main__":
    main()
