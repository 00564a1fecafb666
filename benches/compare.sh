#!/bin/sh
# One table: lanes and rapier at every instruction set of this machine, Pymunk and Box2D, on the same scenes, one core
# each, one after the other; then agreement with Pymunk. Needs a Python with pymunk 7.3.1 (and Box2D 2.3.10, if wanted):
#   python3 -m venv venv && venv/bin/pip install pymunk==7.3.1 Box2D && PYTHON=venv/bin/python benches/compare.sh
set -eu
cd "$(dirname "$0")/.."
python=${PYTHON:-python3}
scenes=$(mktemp -d)
trap 'rm -rf "$scenes"' EXIT

cargo build --quiet --release --bin iplw --example sampled_scenes
for family in bowling basketball; do
    for damping in 1 0.8; do
        target/release/examples/sampled_scenes "$family" 200 "$damping" > "$scenes/$family-$damping.jsonl"
    done
done

for family in bowling basketball; do
    {
        cargo bench --quiet --bench engines -- "$scenes/$family-0.8.jsonl" $("$python" benches/levels.py) rapier
        "$python" benches/pymunk_bench.py "$scenes/$family-0.8.jsonl"
    } | "$python" benches/table.py "$family"
done

for family in bowling basketball; do
    for damping in 1 0.8; do
        echo "== lanes against Pymunk: $family, damping $damping"
        "$python" benches/pymunk_agreement.py target/release/iplw "$scenes/$family-$damping.jsonl"
    done
done
