"""Ten boxes in the batched engine and in Jax2D, on one core with the same scenes, step and iterations, alternating.

    python benches/jax2d_speed.py target/release/iplw [COPIES] [--batches 32]

Both roll out COPIES (32) initial states of `polygon_speed.py`'s stack and of its ten falling boxes, with states read once per second.
Jax2D is compiled in advance for each batch size, unmodified and without the unused features; ours is run from the command line,
including program start and JSON. Processor time, median of three rounds. Needs jax[cpu], jax2d, chex and pymunk.
"""

import argparse
import os
import random
import statistics
import time

# Must be set before JAX is imported: one thread.
os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import jax

import jax2d_scene
from polygon_speed import ROUNDS, SCENES, by_command

#: Pairs that Jax2D solves in parallel; 16 is its default. 4 was as fast, 38 and 75 were slower.
SOLVED_AT_ONCE = 16


def compiled(scenes, batch, engine):
    """(function that rolls the scenes out and returns processor time, s; compilation time, s)."""
    static = jax2d_scene.sizes(scenes[0], SOLVED_AT_ONCE)
    states = [jax2d_scene.start(scenes[at:at + batch], static) for at in range(0, len(scenes), batch)]
    begun = time.process_time()
    roll_out = jax2d_scene.rollouts(scenes[0], static, engine(static)).lower(states[0]).compile()
    to_compile = time.process_time() - begun

    def seconds(_scenes):
        start = time.process_time()
        for state in states:
            jax.block_until_ready(roll_out(state))
        return time.process_time() - start

    return seconds, to_compile


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary")
    parser.add_argument("copies", nargs="?", type=int, default=32)
    parser.add_argument("--batches", nargs="+", type=int, default=[32], help="each divides COPIES")
    given = parser.parse_args()
    if any(given.copies % batch for batch in given.batches):
        parser.error(f"--batches {given.batches}: each is to divide {given.copies}")
    print(f"{'scene':16}{'engine':>16}{'batch':>7}{'compiled':>10}{'us':>10}{'lowest':>10}{'highest':>10}   to lanes, by round")
    for name in ("ten_boxes", "ten_boxes_fall"):
        draw = random.Random(name)
        scenes = [SCENES[name](draw) for _ in range(given.copies)]
        engines = {("lanes", ""): (by_command(given.binary, "lanes"), 0.0)}
        for kind in (jax2d_scene.PhysicsEngine, jax2d_scene.PolygonsOnly):
            engines |= {(kind.__name__, batch): compiled(scenes, batch, kind) for batch in given.batches}
        taken = {engine: [] for engine in engines}
        for _ in range(ROUNDS):
            for engine, (seconds, _) in engines.items():
                taken[engine].append(1e6 * seconds(scenes) / sum(scene["steps"] for scene in scenes))
        for (kind, batch), us in taken.items():
            ratios = [peer / own for peer, own in zip(us, taken["lanes", ""])]
            of_rounds = ", ".join(f"{ratio:.0f}" for ratio in ratios)
            print(f"{name:16}{kind:>16}{batch:>7}{engines[kind, batch][1]:9.0f}s{statistics.median(us):10.3f}{min(us):10.3f}"
                  f"{max(us):10.3f}   {statistics.median(ratios):.0f} x ({of_rounds})", flush=True)


if __name__ == "__main__":
    main()
