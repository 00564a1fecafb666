"""PHYRE-B's 25 templates in our batched engine and in Box2D: do the actions that solve a task in PHYRE solve it here?

    python benches/phyre_templates.py target/release/iplw phyre_b.json.gz [--rate 240] [--random N] [--tasks N]
                                      [--template ID ...] [--verbose]

The file holds tasks by id `TEMPLATE:TASK`, as PHYRE's own files give them: `bodies` (x, y, `angle`, `dynamic`, `kind`,
`shapes`: `circle` or `polygon`, px, in the body's frame), `goal` (`body1` and `body2` by index, touching for 3 s),
`solutions` (actions that solve the task even when they are moved a little) and `random_actions` (how many of PHYRE's
random actions came to -1 nothing, 0 invalid, 2 solved, 3 solved and stable). Nothing of it is part of this project, and
no test needs it. `phyre_tasks.py` makes scenes of them, with Box2D's rules of contact; `box2d_scene.py` runs them in
Box2D (`pip install Box2D`) with PHYRE's iterations at the same time step.

Columns by template: tasks that can be expressed (whose scenes the engine accepts); stable solutions; how many of them solve in
Box2D and in ours, and the ratio; the share of N random valid actions per task that solve in ours, with its 95 % interval,
and PHYRE's share (mean over the same tasks), their ratio, and a * if they differ by more than a factor of 1.5 and their
intervals do not overlap; the number of tasks that are solved in ours without any ball (PHYRE excluded those that are in
Box2D), and ratio and * for the others. `--verbose` lists rejected tasks and those whose solutions solve in only one
engine, one mark per solution: = both, - Box2D only, + ours only, 0 neither.

Differences from PHYRE: no angular damping in ours (0.01 per second in Box2D's); Box2D's polygons have a skin of 0.01 m,
ours have none.
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
    parser.add_argument("--rate", type=int, default=60, help="steps per second (60: PHYRE's; 240: ours)")
    parser.add_argument("--engine", default="lanes", help="engine")
    parser.add_argument("--random", type=int, default=40, metavar="N", help="number of random valid actions per task; 0 for none")
    parser.add_argument("--tasks", type=int, metavar="N", help="number of tasks per template")
    parser.add_argument("--template", nargs="*", help="restrict to these templates")
    parser.add_argument("--verbose", action="store_true", help="print a line for each task in which the two differ")
    options = parser.parse_args()
    templates = phyre_tasks.load(options.data)
    rows = []
    print(f"{'':8} {'said':>7} {'stable':>6} {'Box2D':>6} {'ours':>5} {'ours/Box2D':>10}"
          f"   {'random: ours (95 %)':>26} {'PHYRE':>7} {'ratio':>7} {'alone':>5} {'ratio':>7}")
    for template, tasks in templates.items():
        if not options.template or template in options.template:
            rows.append(Row(template, tasks[:options.tasks], options))
            print(rows[-1].line(), flush=True)
    print(summary(rows))


class Row:
    """Results of a template's tasks."""

    def __init__(self, template, tasks, options):
        self.template, self.tasks, self.options = template, tasks, options
        refused = {name for name, task in tasks if not self.said(name, task)}
        self.taken = [(name, task) for name, task in tasks if name not in refused]
        solutions = [(name, self.scene(name, task, action)) for name, task in self.taken
                     for action in task["solutions"]]
        self.box2d = box2d(scene for _, scene in solutions)
        self.ours = self.run([scene for _, scene in solutions])
        self.chance = {name: self.run([self.scene(name, task, action) for action in
                                       phyre_tasks.valid_actions(name, task, options.random)])
                       for name, task in self.taken} if options.random else {}
        left_alone = self.run([self.scene(name, task, None) for name, task in self.taken])
        self.alone = {name for (name, _), solved in zip(self.taken, left_alone) if solved}
        if options.verbose:
            marks = {}
            for (name, _), *pair in zip(solutions, self.box2d, self.ours):
                marks[name] = marks.get(name, "") + ("0+", "-=")[pair[0]][pair[1]]
            for name, seen in marks.items():
                if set(seen) != {"="}:
                    print(f"    {name} {seen}")

    def scene(self, name, task, action):
        return phyre_tasks.scene(name, task, action, self.options.rate)

    def said(self, name, task):
        """Whether the engine accepts the task with its first solution."""
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

    def rates(self, without=frozenset()):
        """Our rate and its interval; PHYRE's rate and its interval. All tasks have the same number of our actions."""
        own = [phyre_tasks.own_rate(task) for name, task in self.taken if name not in without]
        theirs = sum(p for p, _ in own) / len(own)
        spread = 1.96 * math.sqrt(sum(p * (1 - p) / n for p, n in own)) / len(own)
        chance = [solved for name, results in self.chance.items() if name not in without for solved in results]
        return sum(chance) / len(chance), wilson(chance), theirs, (theirs - spread, theirs + spread)

    def line(self):
        counted = (f"{self.template:8} {len(self.taken):3}/{len(self.tasks):3} {len(self.ours):6} {sum(self.box2d):6}"
                   f" {sum(self.ours):5} {self.share():10.3f}")
        if not self.chance:
            return counted
        everywhere, others = self.rates(), self.rates(self.alone)
        ours, (low, high), theirs, _ = everywhere
        return (f"{counted}   {ours:8.2%} ({low:6.2%} - {high:6.2%}) {theirs:7.2%} {told(everywhere)}"
                f" {len(self.alone):5} {told(others)}")


def alike(rates):
    """Whether the rate is within a factor of 1.5 of PHYRE's, or the intervals overlap."""
    ours, (low, high), theirs, (least, most) = rates
    return (low <= most and least <= high) or theirs / 1.5 <= ours <= theirs * 1.5


def told(rates):
    return f"{rates[0] / rates[2]:5.2f}{' ' if alike(rates) else '*':>2}"


def box2d(scenes):
    import box2d_scene

    return [int(box2d_scene.solved(scene)) for scene in scenes]


def wilson(results):
    """Wilson 95 % confidence interval of a share."""
    n, p, z = len(results), sum(results) / len(results), 1.96
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return middle - half, middle + half


def summary(rows):
    whole = sum(len(row.taken) == len(row.tasks) for row in rows)
    shares = [row.share() for row in rows]
    theirs, ours, known = (sum(map(count, rows)) for count in
                           (lambda r: sum(r.box2d), lambda r: sum(r.ours), lambda r: len(r.ours)))
    found = (f"said in full: {whole} of {len(rows)}; ours/Box2D at least 0.9 in {sum(s >= 0.9 for s in shares)}, mean"
             f" {sum(shares) / len(shares):.3f}; Box2D {theirs} and ours {ours} of {known}")
    if not rows[0].chance:
        return found
    everywhere, others = [row.rates() for row in rows], [row.rates(row.alone) for row in rows]
    return (f"{found}\nrandom: alike in {sum(map(alike, everywhere))} (the others have a *), without"
            f" {sum(len(row.alone) for row in rows)} tasks that solve themselves here in {sum(map(alike, others))}")


if __name__ == "__main__":
    main()
