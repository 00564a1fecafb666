"""Prints the benchmarks' JSON lines as one table, with ratios to Pymunk."""

import json
import sys

rows = [json.loads(line) for line in sys.stdin if line.startswith("{")]
pymunk = next(row["rollouts_per_s"] for row in rows if row["engine"] == "pymunk")
print(f"\n== {sys.argv[1]}, one core\n{'engine':20} {'rollouts/s':>11} {'lowest':>9} {'highest':>9} {'us/step':>9} {'x Pymunk':>9}")
for row in rows:
    low, high = row["rollouts_per_s_range"]
    print(f"{row['engine']:20} {row['rollouts_per_s']:11.0f} {low:9.0f} {high:9.0f} {row['us_per_step']:9.4f}"
          f" {row['rollouts_per_s'] / pymunk:9.1f}")
