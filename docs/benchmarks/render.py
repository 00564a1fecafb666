"""Renders `docs/benchmarks/*.md` from the stored results in `docs/benchmarks/results/*.json`, and measures one anew.

    python docs/benchmarks/render.py                  writes the pages (`make figures`)
    python docs/benchmarks/render.py --check          fails if a page is not what the results make
    python docs/benchmarks/render.py --rerun NAME     runs the command of results/NAME.json, then writes the pages
                                                      (`make figures RERUN=NAME`)

A result is one table: `page` and `order` say where it stands, `title`, `command`, `commit` (null: not noted), `date`, `machine`,
`conditions`, `columns`, `rows` and `notes` what it says. In a command, DIR and FILE stand for an output folder and an output file.

`extract` says how a rerun finds the rows, otherwise the output is kept in out/figures/NAME and the rows are entered by hand:

| `kind` | |
|---|---|
| `columns` | a text table in `file`; the line that begins with `labels[i]` gives the cells of row i after the first |
| `markdown` | the table number `table` of the Markdown file `file`, whole |

Standard library only.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
RESULTS = HERE / "results"

#: Page -> title, introduction.
PAGES: dict[str, tuple[str, str]] = {
    "diagnosis": (
        "Benchmarks: diagnosis",
        "Effects are hidden in generated worlds; the diagnosis sees only trajectories. Terms such as *credible set* are in the\n"
        "[glossary](../glossary.md). Earlier runs and the history of the method are in [full runs](runs/discovery/score.md).\n\n"
        "**All figures on this page are of the decision by held-out predictions** (up to commit 4c38836). The present decision, by evidence with a\n"
        "shared discrepancy, has not been measured at this size; see [how the diagnosis decides](../explanation/diagnosis.md).",
    ),
    "posterior": (
        "Benchmarks: posteriors",
        "What posterior intervals are worth where the model is right and where it is not. How they are computed:\n"
        "[posteriors](../explanation/posterior.md).",
    ),
    "planning": (
        "Benchmarks: planning and designs",
        "AUCCESS of plans under a prior, a posterior and the truth, and what well-chosen experiments add. How it works:\n"
        "[planning](../explanation/planning.md), [designs](../explanation/designs.md).",
    ),
    "policies": (
        "Benchmarks: policies and transfer",
        "Policies trained in simulation and tried in a real world whose physics is hidden. All rows and claims, with discussion:\n"
        "[full runs](runs/README.md).",
    ),
    "agents": (
        "Benchmarks: agents and task collections",
        "What agents learn across families, and what the built-in collections require. How to run it:\n"
        "[compare agents](../how-to/compare_agents.md).",
    ),
    "engines": (
        "Benchmarks: engines",
        "Speed of the engine `lanes` and its agreement with other engines.",
    ),
    "server": ("Benchmarks: server, page and releases", "Speed of the interfaces. Figures on security and robustness: [security](../../SECURITY.md)."),
}


def load() -> dict[str, dict[str, Any]]:
    """All results by name."""
    return {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in sorted(RESULTS.glob("*.json"))}


def cell(text: str) -> str:
    return re.sub(r"\s+", " ", text).replace("|", "\\|")


def table(columns: list[str], rows: list[list[str]]) -> str:
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(cell(part) for part in line) + " |" for line in lines) + "\n"


def provenance(result: dict[str, Any]) -> str:
    commit = f"commit {result['commit']}" if result["commit"] else "commit not noted"
    return "; ".join(part for part in (result["date"], result["machine"], commit, result["conditions"]) if part)


def anchor(title: str) -> str:
    """The anchor that GitHub and Python-Markdown make of a heading."""
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title.lower())).strip("-")


def section(name: str, result: dict[str, Any]) -> str:
    command = result["command"].replace("; ", "\n")
    notes = "".join(f"- {note}\n" for note in result["notes"])
    parts = [
        f"## {result['title']}\n",
        f"```sh\n{command}\n```\n",
        table(result["columns"], result["rows"]),
        notes,
        f"*{provenance(result)}. Stored in `results/{name}.json`.*\n",
    ]
    return "\n".join(part for part in parts if part)


def pages(results: dict[str, dict[str, Any]]) -> dict[str, str]:
    """File name -> text of every page."""
    made = {}
    listed = []
    mark = "<!-- Rendered by `make figures` from docs/benchmarks/results; do not edit. -->\n"
    for page, (title, about) in PAGES.items():
        here = sorted((r["order"], name, r) for name, r in results.items() if r["page"] == page)
        made[f"{page}.md"] = "\n".join([f"# {title}\n", mark, f"{about}\n", *(section(name, r) for _, name, r in here)])
        listed += [[f"[{r['title']}]({page}.md#{anchor(r['title'])})", r["date"], r["commit"] or "", f"`{name}`"] for _, name, r in here]
    made["index.md"] = "\n".join(
        [
            "# Benchmarks\n",
            mark,
            "Every table comes from a stored result with its command, date, machine and commit. `make figures` renders the pages,\n"
            "`make figures RERUN=NAME` measures one anew. Data and discussion of the long experiments: [full runs](runs/README.md).\n",
            table(["result", "measured", "commit", "name"], listed),
        ]
    )
    return made


def rerun(name: str) -> None:
    """Runs the stored command of a result and stores what it gave."""
    file = RESULTS / f"{name}.json"
    if not file.is_file():
        raise SystemExit(f"no result is named {name!r}; allowed: {', '.join(load())}")
    result = json.loads(file.read_text(encoding="utf-8"))
    out = ROOT / "out" / "figures" / name
    out.mkdir(parents=True, exist_ok=True)
    command = re.sub(r"\bFILE\b", str(out / "result.md"), re.sub(r"\bDIR\b", str(out), result["command"]))
    path = os.pathsep.join([str(ROOT / "target" / "release"), os.environ["PATH"]])
    done = subprocess.run(
        ["bash", "-ec", command], cwd=ROOT, env={**os.environ, "PATH": path}, text=True, stdout=subprocess.PIPE, stderr=None
    )
    (out / "stdout.txt").write_text(done.stdout, encoding="utf-8")
    sys.stdout.write(done.stdout)
    if done.returncode:
        raise SystemExit(f"`{command}` ended with exit code {done.returncode}; {name} is as it was")
    rows = extracted(result, out)
    if rows is None:
        raise SystemExit(f"{name} has no `extract`: enter its rows, commit, date and machine in {file.relative_to(ROOT)} from {out}")
    git = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.run(git, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    machine = f"{os.cpu_count()}-core {platform.machine()}"
    result |= {"rows": rows, "commit": commit, "date": datetime.date.today().isoformat(), "machine": machine, "conditions": ""}
    file.write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def extracted(result: dict[str, Any], out: Path) -> list[list[str]] | None:
    """Rows of the output by the result's `extract`; None without one."""
    how = result.get("extract")
    if how is None:
        return None
    text = (out / how["file"]).read_text(encoding="utf-8")
    if how["kind"] == "columns":
        rows = []
        for label, row in zip(how["labels"], result["rows"], strict=True):
            found = re.search(rf"^{re.escape(label)}\s(.*)$", text, re.MULTILINE)
            cells = re.split(r"\s{2,}", found[1].strip()) if found else []
            if len(cells) < len(row) - 1:
                raise SystemExit(f"{how['file']} has no line `{label}` with {len(row) - 1} cells")
            rows.append([row[0], *cells[: len(row) - 1]])
        return rows
    if how["kind"] == "markdown":
        tables = re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
        lines = tables[how["table"]].splitlines()[2:]
        return [[part.strip() for part in re.split(r"(?<!\\)\|", line.strip().strip("|"))] for line in lines]
    raise SystemExit(f"`extract.kind` is {how['kind']!r}; allowed: columns, markdown")


def stale() -> list[str]:
    """Pages that are not what the results make."""
    made = pages(load())
    there = {file.name for file in HERE.glob("*.md")}
    differ = [name for name, text in made.items() if name not in there or (HERE / name).read_text(encoding="utf-8") != text]
    return differ + sorted(there - made.keys())


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--check", action="store_true", help="fail if a page is not up to date")
    options.add_argument("--rerun", metavar="NAME", help="run the stored command of a result first")
    given = options.parse_args()
    if given.check:
        differ = stale()
        for name in differ:
            print(f"docs/benchmarks/{name} is not what docs/benchmarks/results make: make figures", file=sys.stderr)
        return 1 if differ else 0
    if given.rerun:
        rerun(given.rerun)
    for name, text in pages(load()).items():
        (HERE / name).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
