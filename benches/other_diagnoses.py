"""Compares the diagnosis with two others of the same free flights: least squares with BIC, and PySINDy.

    pip install scipy pandas pysindy
    python benches/other_diagnoses.py DIR --out FILE

DIR has a folder for each matrix: the rows of `hidden_effects` (`worlds.csv`) or `hidden_recordings` (`recordings.csv`), and in `worlds`
what the same run exported (`--export`). Each diagnosis is appended to `diagnoses.jsonl` in DIR, and an interrupted run resumes; worlds without
a row of the program, or not in free flight, are left out.

Methods: `flight_fits.py` names the sets whose BIC is within 2 of the lowest; also with correlated residuals counted for less, and also unknown
if they have more than twice the variance of the noise. `flight_sindy.py` names the laws of the active terms.

Every method is scored by one rule. *right alone*: one set, the hidden one; *in the set*: one of at most four; *unknown*; *nothing*: no
effect; *wrong*: any other name. Sets that flights cannot distinguish are one: gravity, scale and clock; a tilted camera and wind across; a
tilted camera with another gravity and wind.
Where nothing, or a force outside the library, is hidden, every name is wrong.
"""

import argparse
import json
import math
import statistics
import sys
import time
from collections import Counter
from pathlib import Path

import flight_fits
import flight_sindy
import flight_trials

#: Columns of the verdict, the sets and the time in the rows of the program.
ROWS = {"worlds.csv": (3, 4, 8), "recordings.csv": (8, 9, 13)}
#: Matrices that are known, in the order of the table.
MATRICES = {"clean": "clean", "trials": "dirt by trial", "shared": "shared dirt"}
#: Ways to decide by BIC, as arguments of `flight_fits.decide`.
DECISIONS = {
    "BIC": {},
    "BIC, correlated": {"correlated": True},
    "BIC, correlated and tested": {"correlated": True, "tested": True},
}
METHODS = ["iplw", *DECISIONS, "PySINDy"]
GRAVITY_TWINS = ("gravity_error", "position_scale", "time_scale")
MOST_RIVALS = 4


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of the matrices: " + ", ".join(MATRICES))
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="output file of the table")
    parser.add_argument("--worlds", type=int, default=10**9, metavar="N", help="study at most N worlds of each matrix")
    asked = parser.parse_args()
    there = [name for name in MATRICES if (asked.folder / name).is_dir()]
    if not there:
        parser.error(f"{asked.folder} has none of the folders {', '.join(MATRICES)}")
    log = asked.folder / "diagnoses.jsonl"
    worlds = [world for name in there for world in exported(asked.folder / name, name)[:asked.worlds]]
    rows = study(worlds, log)
    text = table(rows) + "\n" + confusion(rows)
    print(text, end="")
    asked.out.write_text(text, encoding="utf-8")


def exported(folder, matrix):
    """Worlds of a matrix in free flight, with the program's row of each."""
    logs = [name for name in ROWS if (folder / name).is_file()]
    if len(logs) != 1:
        sys.exit(f"{folder} has {len(logs)} of {' and '.join(ROWS)}; one is needed: run the example with `--out {folder}/table.md`")
    out = []
    for line in (folder / logs[0]).read_text(encoding="utf-8").splitlines():
        cells = line.split(",")
        own = folder / "worlds" / cells[0]
        if cells[1].startswith("advice followed"):
            continue
        if not (own / "truth.json").is_file():
            sys.exit(f"{own} is not there: run the example with `--export {folder / 'worlds'}`")
        truth = json.loads((own / "truth.json").read_text(encoding="utf-8"))
        if truth["free_flight"]:
            verdict, sets, seconds = (cells[at] for at in ROWS[logs[0]])
            given = {"verdict": verdict, "sets": [one.split("+") if one else [] for one in sets.split("|")], "seconds": float(seconds)}
            out.append({"matrix": matrix, "id": cells[0], "folder": own, "truth": truth, "given": given})
    return out


def study(worlds, log):
    """Rows of all worlds and methods; those that the log lacks are computed."""
    known = {}
    if log.is_file():
        for line in log.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            known[row["matrix"], row["id"], row["method"]] = row
    rows, begun = [], time.perf_counter()
    for number, world in enumerate(worlds, 1):
        flights = None
        for method in ("BIC", "PySINDy"):
            key = world["matrix"], world["id"], method
            if key not in known:
                flights = flights or flight_trials.read(world["folder"])[0]
                known[key] = dict(zip(("matrix", "id", "method"), key)) | diagnosed(method, flights)
                with log.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(known[key]) + "\n")
            rows += verdicts(known[key])
        if flights:
            print(f"{number} of {len(worlds)} worlds, {time.perf_counter() - begun:.0f} s", file=sys.stderr, flush=True)
        rows.append({"matrix": world["matrix"], "id": world["id"], "method": "iplw"} | world["given"])
        for row in rows[-len(METHODS):]:
            row |= {"truth": world["truth"], "outcome": outcome(row["verdict"], row["sets"], world["truth"])}
    return rows


def diagnosed(method, flights):
    begun = time.perf_counter()
    if method == "BIC":
        found = {"fits": flight_fits.fits(flights)}
    else:
        verdict, names = flight_sindy.diagnose(flights)
        found = {"verdict": verdict, "sets": [names]}
    return found | {"seconds": round(time.perf_counter() - begun, 2)}


def verdicts(row):
    """Rows of the table of a row of the log: fits are decided in several ways."""
    if "fits" not in row:
        return [row]
    found, rest = row["fits"], {key: value for key, value in row.items() if key != "fits"}
    decided = {method: flight_fits.decide(found, **how) for method, how in DECISIONS.items()}
    return [rest | {"method": method, "verdict": verdict, "sets": sets} for method, (verdict, sets) in decided.items()]


def outcome(verdict, sets, truth):
    """What a verdict is worth."""
    if verdict == "Unknown":
        return "unknown"
    right = {plain(one) for one in truth["right"]}
    if truth["kind"].startswith("nothing"):
        right = {frozenset()}
    given = [plain(one) for one in sets] if verdict not in ("None", "InsufficientData") else [frozenset()]
    rivals = len(set(given) - right) + bool(right & set(given))
    if right & set(given) and rivals <= MOST_RIVALS:
        return "right alone" if rivals == 1 else "in the set"
    return "wrong" if given[0] else "nothing"


def plain(names):
    """A set, in place of all that flights cannot distinguish from it."""
    names = {"gravity_error" if name in GRAVITY_TWINS else name for name in names}
    if {"camera_tilt", "gravity_error"} <= names:
        names = names - {"camera_tilt", "gravity_error"} | {"wind"}
    return frozenset(names)


def wilson(right, number):
    """The 95 % interval of a share by Wilson's score (J. Am. Stat. Assoc. 22 (1927) 209), in percent."""
    z, share = 1.959964, right / number
    middle = share + z * z / (2 * number)
    reach = z * math.sqrt(share * (1 - share) / number + z * z / (4 * number * number))
    return [100 * min(max((middle + side * reach) / (1 + z * z / number), 0.0), 1.0) for side in (-1, 1)]


def cell(rows, *outcomes):
    """Number of worlds with one of some outcomes, of all, with its interval."""
    if not rows:
        return "none"
    count = sum(row["outcome"] in outcomes for row in rows)
    low, high = wilson(count, len(rows))
    return f"{count} of {len(rows)}; {low:.0f} to {high:.0f} %"


def false_alarms(rows):
    """Of worlds in which nothing is hidden: nothing found, and a name."""
    right, named = (sum(row["outcome"] in some for row in rows) for some in (("right alone",), ("wrong", "in the set")))
    return f"{right}; {cell(rows, 'wrong', 'in the set')}" if rows else "none"


def table(rows):
    """Counts of each matrix and method, with 95 % intervals."""
    columns = ["flights", "method", "right alone", "in the set", "unknown", "nothing", "wrong", "nothing hidden: nothing; a name",
               "outside the library: a name", "median time"]
    lines = [columns, ["---"] * len(columns)]
    for matrix, title in MATRICES.items():
        for method in METHODS:
            own = [row for row in rows if row["matrix"] == matrix and row["method"] == method]
            if not own:
                continue
            kind = lambda start: [row for row in own if row["truth"]["kind"].startswith(start)]
            nothing, outside = kind("nothing"), kind("outside")
            hidden = [row for row in own if row not in nothing and row not in outside]
            shares = [cell(hidden, one) for one in ("right alone", "in the set", "unknown", "nothing", "wrong")]
            seconds = statistics.median(row["seconds"] for row in own)
            lines.append([title, method, *shares, false_alarms(nothing), cell(outside, "wrong"), f"{seconds:.1f} s"])
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def confusion(rows):
    """What is hidden in each world, and what each method says of it."""
    lines = [["flights", "method", "hidden", "diagnosed", "outcome", "worlds"], ["---"] * 6]
    counts = Counter()
    for row in rows:
        hidden = "+".join(row["truth"]["right"][0]) if row["truth"]["right"] else row["truth"]["kind"]
        sets = " or ".join("+".join(one) or "nothing" for one in row["sets"])
        counts[row["matrix"], row["method"], hidden, f"{row['verdict']} {sets}".strip(), row["outcome"]] += 1
    order = lambda key: (list(MATRICES).index(key[0]), METHODS.index(key[1]), *key[2:])
    lines += [[*key, str(counts[key])] for key in sorted(counts, key=order)]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


if __name__ == "__main__":
    main()
