#!/bin/sh
# Comparison table: lanes and rapier at every instruction set of this machine, Pymunk and Box2D, on the same scenes, one core
# each, in sequence; lanes relative to the machine's limits; its profile; agreement with Pymunk.
# The environment variables SCENES (200 per family) and MOST (100000 rollouts, for memory) reduce the run.
# Needs a Python with pymunk 7.3.1 (and optionally Box2D 2.3.10):
#   python3 -m venv venv && venv/bin/pip install pymunk==7.3.1 Box2D && PYTHON=venv/bin/python benches/compare.sh
set -eu
cd "$(dirname "$0")/.."
python=${PYTHON:-python3}
scenes=$(mktemp -d)
trap 'rm -rf "$scenes"' EXIT

count=${SCENES:-200}

cargo build --quiet --release --bin iplw --example sampled_scenes
cargo bench --quiet --features levels --no-run --bench engines --bench limits
for family in bowling basketball; do
    for damping in 1 0.8; do
        target/release/examples/sampled_scenes "$family" "$count" "$damping" > "$scenes/$family-$damping.jsonl"
    done
done

for family in bowling basketball; do
    {
        cargo bench --quiet --features levels --bench engines -- "$scenes/$family-0.8.jsonl" $("$python" benches/levels.py) rapier
        "$python" benches/pymunk_bench.py "$scenes/$family-0.8.jsonl"
    } | "$python" benches/table.py "$family"
done

cargo bench --quiet --features levels --bench limits -- "$scenes/bowling-0.8.jsonl" "${MOST:-100000}"
# The newest build of the benchmark is the one that just ran.
"$python" benches/profile.py "$(ls -t target/release/deps/engines-* | grep -v '\.d$' | head -n 1)" "$scenes/bowling-0.8.jsonl"

for family in bowling basketball; do
    for damping in 1 0.8; do
        echo "== lanes against Pymunk: $family, damping $damping"
        "$python" benches/pymunk_agreement.py target/release/iplw "$scenes/$family-$damping.jsonl"
    done
done
