"""Writes golden Pymunk trajectories: reads scenes as JSON lines, writes tests/golden/NAME.json.

    cargo run --release --example sampled_scenes -- bowling 30 0.8 | python benches/pymunk_golden.py bowling_damped

    python benches/polygon_scenes.py 30 1 | python benches/pymunk_golden.py polygons 2

Damping 1 gives NAME bowling or basketball, damping 0.8 gives NAME_damped. Pymunk runs with its defaults, for 4 s or for so many as
are given.
"""

import json
import pathlib
import sys

import pymunk

import pymunk_scene

TIMES = (1.0, 2.0, 4.0)


def trajectory(scene, most):
    space, bodies = pymunk_scene.build(scene)
    dt = scene["time_step"]
    steps, seen = [], []
    for time in (t for t in TIMES if t <= most):
        step = round(time / dt)
        for _ in range(step - (steps[-1] if steps else 0)):
            space.step(dt)
        steps.append(step)
        seen.append([[b.position.x, b.position.y] for b in bodies])
    return {"scene": scene, "steps": steps, "positions": seen}


def main():
    most = float(sys.argv[2]) if len(sys.argv) > 2 else max(TIMES)
    rows = [json.dumps(trajectory(json.loads(line), most)) for line in sys.stdin]
    out = pathlib.Path(__file__).parent.parent / "tests" / "golden" / f"{sys.argv[1]}.json"
    out.parent.mkdir(exist_ok=True)
    out.write_text('{"pymunk": "%s", "rollouts": [\n%s\n]}\n' % (pymunk.version, ",\n".join(rows)))


if __name__ == "__main__":
    main()
