"""PHYRE-B's 25 templates in our batched engine and in Box2D: do the actions that solve a task in PHYRE solve it here?

    python benches/phyre_templates.py target/release/iplw phyre_b.json.gz [--rate 60] [--random 40] [--tasks N] [--template ID ...]

The file holds tasks by id `TEMPLATE:TASK`, as PHYRE's own files give them: `bodies` (x, y, `angle`, `dynamic`, `kind`, `shapes`:
`circle` or `polygon`, px, in the body's frame), `goal` (`body1` and `body2` by index, touching for 3 s), `solutions` (actions that solve the
task even when they are moved a little) and `random_actions` (how many of PHYRE's random actions came to -1 nothing, 0 invalid, 2
solved, 3 solved and stable). Nothing of it is part of this project, and no test needs it. `phyre_tasks.py` makes scenes of them,
with Box2D's rules of contact; `box2d_scene.py` runs them in Box2D (PyPI: Box2D) with PHYRE's iterations at the same time step.

By template: tasks that can be said (whose scenes the engine takes); stable solutions; how many of them Box2D and we solve, and the share
of ours to Box2D's; the share of RANDOM random valid actions a task that solve here, with its 95 % interval, beside PHYRE's own (mean over the same
tasks), and their ratio. `--verbose` names the tasks whose solutions one side alone solves. `--engine NAME=COMMAND` adds another of our programs.

Differences from PHYRE: no angular damping in ours (0.01 per second in Box2D's); Box2D's polygons have a skin of 0.01 m, ours have none.
"""

import argparse
import json
import math
import subprocess

import phyre_tasks


def main():
    parser = argparse.ArgumentParser(description="PHYRE's known solutions in our batched engine and in Box2D")
    parser.add_argument("binary")
    parser.add_argument("data")
    parser.add_argument("--rate", type=int, default=60, help="steps a second (60: PHYRE's; 240: ours)")
    parser.add_argument("--engine", default="lanes", help="which of our engines")
    parser.add_argument("--random", type=int, default=40, metavar="N", help="random valid actions a task; 0: none")
    parser.add_argument("--tasks", type=int, metavar="N", help="the first N tasks of a template only")
    parser.add_argument("--template", nargs="*", help="these templates only")
    parser.add_argument("--verbose", action="store_true", help="a line for each task where the two differ")
    options = parser.parse_args()
    templates = phyre_tasks.load(options.data)
    rows = []
    print(f"{'':8} {'said':>7} {'stable':>6} {'Box2D':>6} {'ours':>5} {'ours/Box2D':>10}   {'random: ours (95 %)':>24} {'PHYRE':>7} {'ratio':>5}")
    for template, tasks in templates.items():
        if not options.template or template in options.template:
            rows.append(Row(template, tasks[:options.tasks], options))
            print(rows[-1].line(), flush=True)
    print(summary(rows))


class Row:
    """What a template's tasks came to."""

    def __init__(self, template, tasks, options):
        self.template, self.tasks, self.options = template, tasks, options
        refused = {name for name, task in tasks if not self.said(name, task)}
        self.taken = [(name, task) for name, task in tasks if name not in refused]
        solutions = [(name, action, self.scene(name, task, action)) for name, task in self.taken for action in task["solutions"]]
        self.box2d = box2d(scene for *_, scene in solutions)
        self.ours = self.run([scene for *_, scene in solutions])
        chances = [self.scene(name, task, action) for name, task in self.taken
                   for action in phyre_tasks.valid_actions(name, task, options.random)]
        self.chance = self.run(chances)
        if options.verbose:
            told = {}
            for (name, *_), theirs, own in zip(solutions, self.box2d, self.ours):
                told[name] = told.get(name, "") + {(0, 0): "0", (0, 1): "+", (1, 0): "-", (1, 1): "="}[theirs, own]
            print("\n".join(f"    {name} {marks}" for name, marks in told.items() if set(marks) & set("+-0")))

    def scene(self, name, task, action):
        return phyre_tasks.scene(name, task, action, self.options.rate)

    def said(self, name, task):
        """Whether the engine takes the task with its first solution."""
        ran = self.rollout([self.scene(name, task, task["solutions"][0])])
        if ran.returncode != 0 and self.options.verbose:
            print(f"    {name} refused: {ran.stderr.strip()}")
        return ran.returncode == 0

    def run(self, scenes):
        ran = self.rollout(scenes)
        if ran.returncode != 0:
            raise SystemExit(f"{self.template}: {ran.stderr.strip()}")
        return [int(bool(json.loads(line)["solved"])) for line in ran.stdout.splitlines()]

    def rollout(self, scenes):
        command = [self.options.binary, "rollout", "--engine", self.options.engine, "--threads", "1"]
        return subprocess.run(command, input="\n".join(map(json.dumps, scenes)), capture_output=True, text=True)

    def share(self):
        return sum(self.ours) / max(1, sum(self.box2d))

    def rates(self):
        """Ours, its interval; PHYRE's, its interval. Every task has as many of our random actions, so that the pooled share is the mean."""
        own = [phyre_tasks.own_rate(task) for _, task in self.taken]
        theirs = sum(p for p, _ in own) / len(own)
        spread = 1.96 * math.sqrt(sum(p * (1 - p) / n for p, n in own)) / len(own)
        return sum(self.chance) / len(self.chance), wilson(self.chance), theirs, (theirs - spread, theirs + spread)

    def alike(self):
        """Within 1.5 times of PHYRE's own rate, or intervals that overlap."""
        ours, (low, high), theirs, (least, most) = self.rates()
        return (low <= most and least <= high) or theirs / 1.5 <= ours <= theirs * 1.5

    def line(self):
        counted = (f"{self.template:8} {len(self.taken):3}/{len(self.tasks):3} {len(self.ours):6} {sum(self.box2d):6} {sum(self.ours):5}"
                   f" {self.share():10.3f}")
        if not self.chance:
            return counted
        ours, (low, high), theirs, _ = self.rates()
        return f"{counted}   {ours:8.2%} ({low:6.2%} - {high:6.2%}) {theirs:7.2%} {ours / theirs:5.2f}{'' if self.alike() else ' *'}"


def box2d(scenes):
    import box2d_scene

    return [int(box2d_scene.solved(scene)) for scene in scenes]


def wilson(results):
    """95 % interval of a share."""
    n, p, z = len(results), sum(results) / len(results), 1.96
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return middle - half, middle + half


def summary(rows):
    whole = sum(len(row.taken) == len(row.tasks) for row in rows)
    shares = [row.share() for row in rows]
    found = (f"said in full: {whole} of {len(rows)}; ours/Box2D at least 0.9 in {sum(s >= 0.9 for s in shares)},"
             f" mean {sum(shares) / len(shares):.3f}; Box2D {sum(sum(r.box2d) for r in rows)} and ours {sum(sum(r.ours) for r in rows)}"
             f" of {sum(len(r.ours) for r in rows)}")
    if not rows[0].chance:
        return found
    ratios = [ours / theirs for ours, _, theirs, _ in (row.rates() for row in rows)]
    return f"{found}\nrandom: alike in {sum(row.alike() for row in rows)} (the others have a *), mean ratio {sum(ratios) / len(ratios):.2f}"


if __name__ == "__main__":
    main()
