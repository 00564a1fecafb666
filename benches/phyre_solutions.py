"""PHYRE's own tasks and solutions in our engines: do the actions that its authors found to solve a task solve it here?

    python benches/phyre_solutions.py target/release/iplw phyre_00000.json [--random N] [--pymunk] [--verbose]

The file holds tasks of PHYRE's template 00000 ("green and blue touch for 3 s") in pixels, each with actions that solve
it in PHYRE's Box2D: `solutions` still do so after small perturbations, `unstable_solutions` do not. Nothing of it is
part of this project, and no test needs it.

Prints, for each engine, the share of stable solutions solved with its 95 % interval (Wilson), the share of unstable
ones, and the share of N random valid actions a task that solve theirs (drawn by a fixed seed; valid: the red ball
overlaps nothing and lies within the scene), with `--verbose` task by task. `--pymunk` adds Pymunk at its defaults on
the same scenes, the goal judged every step as ours is.

Differences from PHYRE: contact coefficients are products of surfaces that each carry the square root of PHYRE's
friction 0.5 and restitution 0.2, where Box2D mixes friction by geometric mean and restitution by maximum; 1/240 s in
place of 1/60 s; no angular damping (0.01: 0.01 % of spin a step at 1/60 s); a ball's outline is a circle.
"""

import argparse
import json
import math
import random
import subprocess

PIXELS_PER_METRE = 6.0
SIDE = 256 / PIXELS_PER_METRE
WALL = 5 / PIXELS_PER_METRE
SURFACE = {"friction": math.sqrt(0.5), "restitution": math.sqrt(0.2)}
STEP, STEPS = 1 / 240, 4000
HOLD = 3.0
TOLERANCE = 0.1 / PIXELS_PER_METRE


def main():
    parser = argparse.ArgumentParser(description="PHYRE's known solutions in our engines")
    parser.add_argument("binary")
    parser.add_argument("data")
    parser.add_argument("--random", type=int, default=200, metavar="N", help="random valid actions a task")
    parser.add_argument("--pymunk", action="store_true", help="Pymunk beside our engines")
    parser.add_argument("--verbose", action="store_true", help="a line for each task and engine")
    options = parser.parse_args()
    with open(options.data) as file:
        tasks = json.load(file)
    groups = {
        "stable": [(i, scene(task, a)) for i, task in enumerate(tasks) for a in task["solutions"]],
        "unstable": [(i, scene(task, a)) for i, task in enumerate(tasks) for a in task["unstable_solutions"]],
        "random": [(i, scene(task, a)) for i, task in enumerate(tasks) for a in valid_actions(task, i, options.random)],
    }
    engines = {name: lambda scenes, name=name: ours(options.binary, name, scenes) for name in ("lanes", "rapier")}
    if options.pymunk:
        engines["pymunk"] = pymunk_solved
    print(f"{'engine':8} {'stable solved':>32} {'unstable solved':>22} {'random solved':>22} {'by task':>14}")
    for engine, solve in engines.items():
        found = {name: list(zip((i for i, _ in group), solve([s for _, s in group])))
                 for name, group in groups.items()}
        stable, unstable, chance = found["stable"], found["unstable"], found["random"]
        by_task = [share([r for i, r in chance if i == task]) for task in range(len(tasks))]
        print(f"{engine:8} {told(stable):>18} {interval(stable)} {told(unstable):>22} {told(chance):>22}"
              f" {min(by_task):5.1%} to {max(by_task):5.1%}", flush=True)
        if options.verbose:
            for i, task in enumerate(tasks):
                marks = "".join("+" if r else "-" for k, r in stable if k == i)
                print(f"    {task['task']} stable {marks:6} random {by_task[i]:6.1%}")


def scene(task, action):
    """The task with the action carried out, as `iplw.scene/1`."""
    half, near, far = SIDE / 2, -WALL / 2, SIDE + WALL / 2

    def wall(name, position, half_width, half_height):
        shape = {"type": "box", "half_width": half_width, "half_height": half_height}
        return {"name": name, "shape": shape, "position": position, **SURFACE}

    def ball(name, disc):
        x, y, r = (v / PIXELS_PER_METRE for v in disc)
        return {"name": name, "shape": {"type": "disc", "radius": r}, "density": 0.25, "position": [x, y], **SURFACE}

    return {
        "format": "iplw.scene/1",
        "name": task["task"],
        "gravity": [0.0, -9.8],
        "bodies": [ball(name, disc) for name, disc in zip(("green", "blue", "red"), discs(task, action))],
        "statics": [
            wall("floor", [half, near], half + WALL, WALL / 2),
            wall("ceiling", [half, far], half + WALL, WALL / 2),
            wall("left_wall", [near, half], WALL / 2, half),
            wall("right_wall", [far, half], WALL / 2, half),
        ],
        "time_step": STEP,
        "steps": STEPS,
        "observe_every": STEPS,
        "goal": {"type": "contact", "bodies": ["green", "blue"], "hold_s": HOLD, "tolerance": TOLERANCE},
    }


def discs(task, action):
    """(x, y, radius) of green, blue and red, pixels."""
    x, y, r = action
    own = [(task[name]["x"], task[name]["y"], task[name]["r"]) for name in ("green", "blue")]
    return [*own, (x * 255, y * 255, 2 + 30 * r)]


def valid_actions(task, number, count):
    draw = random.Random(f"phyre {number}")
    actions = []
    while len(actions) < count:
        action = [draw.random() for _ in range(3)]
        *others, (x, y, r) = discs(task, action)
        within = r <= x <= 256 - r and r <= y <= 256 - r
        if within and all(math.dist((x, y), other[:2]) >= r + other[2] for other in others):
            actions.append(action)
    return actions


def ours(binary, engine, scenes):
    lines = "\n".join(map(json.dumps, scenes))
    ran = subprocess.run([binary, "rollout", "--engine", engine], input=lines, capture_output=True, text=True)
    if ran.returncode != 0:
        raise SystemExit(ran.stderr.strip())
    return [json.loads(line)["solved"] for line in ran.stdout.splitlines()]


def pymunk_solved(scenes):
    import pymunk_scene

    def solved(scene):
        space, (green, blue, _) = pymunk_scene.build(scene)
        reach = TOLERANCE + sum(body["shape"]["radius"] for body in scene["bodies"][:2])
        held, needed = 0, math.ceil(HOLD / STEP - 1e-9)
        for _ in range(STEPS):
            space.step(STEP)
            held = held + 1 if green.position.get_distance(blue.position) <= reach else 0
            if held >= needed:
                return True
        return False

    return [solved(s) for s in scenes]


def share(results):
    return sum(results) / max(1, len(results))


def told(results):
    solved = [r for _, r in results]
    return f"{sum(solved)} of {len(solved)}, {share(solved):.1%}"


def interval(results):
    """Wilson's 95 % interval of a share."""
    n, p, z = len(results), share([r for _, r in results]), 1.96
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return f"({middle - half:.0%} to {middle + half:.0%})"


if __name__ == "__main__":
    main()
