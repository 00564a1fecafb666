"""Builds the documentation site: assembles the sources of its pages, runs mkdocs, and checks the result.

    python docs/site/build.py --bin target/debug/iplw        out/pages -> out/site; any warning is an error

| part | source |
|---|---|
| documents | `docs/KIND/*.md`, `CHANGELOG.md`, `SECURITY.md`, ...; links rewritten for the site (`links.py`) |
| Python | docstrings, read without imports (`python_pages.py`, `comments.py`) |
| HTTP | `openapi/openapi.json` (`http_pages.py`) |
| command line | `--help` of every command (`commands.py`) |
| tutorials | `examples/notebooks/*.ipynb` (`notebooks.py`) |
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import yaml

from commands import commands_page
from diagrams import DIAGRAMS, replace_diagrams
from check_documents import problems
from http_pages import http_pages
from links import Links
from markdown_text import normalize_lists
from notebooks import notebook_page
from python_pages import PAGES, python_pages

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
OUT = ROOT / "out"
SOURCES = ROOT / "clients" / "python" / "src"

#: Path in the repository -> path on the site, title in the navigation. Other documents follow those of their section.
DOCUMENTS: dict[str, tuple[str, str]] = {
    "docs/how-to/install.md": ("how-to/install.md", "Install"),
    "docs/glossary.md": ("glossary.md", "Glossary"),
    "docs/tutorials/diagnose_a_ball.md": ("tutorials/diagnose_a_ball.md", "Diagnose a thrown ball"),
    "docs/tutorials/from_trials_to_a_policy.md": ("tutorials/from_trials_to_a_policy.md", "From trials to a policy"),
    "docs/gallery/index.md": ("gallery/index.md", "Gallery"),
    "docs/how-to/how_many_trials.md": ("how-to/how_many_trials.md", "How many launches do I need?"),
    "docs/how-to/use_the_page.md": ("how-to/use_the_page.md", "Use the web page"),
    "docs/how-to/run_a_server.md": ("how-to/run_a_server.md", "Run a server"),
    "docs/how-to/many_machines.md": ("how-to/many_machines.md", "Use many machines"),
    "docs/how-to/import_tasks.md": ("how-to/import_tasks.md", "Import tasks"),
    "docs/how-to/compare_agents.md": ("how-to/compare_agents.md", "Compare agents"),
    "docs/how-to/agents.md": ("how-to/agents.md", "Connect an agent (MCP)"),
    "docs/how-to/openenv.md": ("how-to/openenv.md", "Use OpenEnv"),
    "docs/how-to/extend.md": ("how-to/extend.md", "Extend the program"),
    "docs/reference/formats.md": ("reference/formats.md", "Formats and commands"),
    "docs/reference/limits.md": ("reference/limits.md", "Limits"),
    "docs/reference/zeromq.md": ("reference/zeromq.md", "ZeroMQ"),
    "docs/reference/environments.md": ("reference/environments.md", "Environments"),
    "docs/reference/levels.md": ("reference/levels.md", "Levels"),
    "docs/reference/phyre.md": ("reference/phyre.md", "PHYRE's templates"),
    "SECURITY.md": ("security.md", "Security"),
    "docs/explanation/diagnosis.md": ("explanation/diagnosis.md", "How the diagnosis decides"),
    "docs/explanation/verdicts.md": ("explanation/verdicts.md", "Interpretation of the verdicts"),
    "docs/explanation/mechanisms.md": ("explanation/mechanisms.md", "Driven mechanisms"),
    "docs/explanation/posterior.md": ("explanation/posterior.md", "Posteriors"),
    "docs/explanation/planning.md": ("explanation/planning.md", "Planning"),
    "docs/explanation/designs.md": ("explanation/designs.md", "Designs"),
    "docs/explanation/paper_reproduced.md": ("explanation/paper_reproduced.md", "The paper reproduced"),
    "docs/explanation/gpu.md": ("explanation/gpu.md", "The GPU engine"),
    "docs/explanation/three_dimensions.md": ("explanation/three_dimensions.md", "3D?"),
    "docs/calibration.md": ("explanation/calibration.md", "How constants were chosen"),
    "docs/explanation/architecture.md": ("explanation/architecture.md", "Architecture"),
    "docs/benchmarks/index.md": ("benchmarks/index.md", "Summary"),
    "docs/benchmarks/runs/README.md": ("benchmarks/runs.md", "Full runs"),
    "clients/python/README.md": ("python/index.md", "Guide"),
    "web/README.md": ("web.md", "The page"),
    "CONTRIBUTING.md": ("contributing.md", "Contributing"),
    "CHANGELOG.md": ("changelog.md", "Changelog"),
}
#: Folder below `docs/` -> title in the navigation (Diataxis: tutorials, how-to, reference, explanation; and benchmarks).
SECTIONS = {
    "tutorials": "Tutorials",
    "how-to": "How to",
    "reference": "Reference",
    "explanation": "Explanation",
    "benchmarks": "Benchmarks",
}
PROJECT = ("web/README.md", "CONTRIBUTING.md", "CHANGELOG.md")


def documents() -> dict[str, tuple[str, str]]:
    """All documents, including those without a row above."""
    result = dict(DOCUMENTS)
    for section in SECTIONS:
        for file in sorted((ROOT / "docs" / section).glob("*.md")):
            heading = file.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
            result.setdefault(f"docs/{section}/{file.name}", (f"{section}/{file.name}", heading))
    return {source: page for source, page in result.items() if (ROOT / source).is_file()}


def assemble(binary: Path, pages: Path) -> list[Any]:
    """Writes the sources of the pages, and returns mkdocs' `nav`."""
    shutil.rmtree(pages, ignore_errors=True)
    shutil.copytree(HERE / "pages", pages)
    shutil.copytree(DIAGRAMS, pages / "diagrams")
    result = documents()
    links = Links(ROOT, pages, {source: page for source, (page, _) in result.items()})
    for source, (page, _) in result.items():
        text = links.rewrite((ROOT / source).read_text(encoding="utf-8"), source, page)
        write(pages / page, normalize_lists(replace_diagrams(text, "../" * page.count("/"))))
    generated = python_pages(SOURCES)
    generated |= http_pages(json.loads((ROOT / "openapi" / "openapi.json").read_text(encoding="utf-8")))
    generated["commands.md"] = commands_page(binary)
    for page, text in generated.items():
        write(pages / page, text)
    (pages / "files" / "openapi").mkdir(parents=True, exist_ok=True)
    shutil.copyfile(ROOT / "openapi" / "openapi.json", pages / "files" / "openapi" / "openapi.json")
    tutorials = []
    for notebook in sorted((ROOT / "examples" / "notebooks").glob("*.ipynb")):
        target = pages / "tutorials" / f"{notebook.stem}.md"
        # The notebook is copied next to its page.
        link = f"\nDownload this page as a notebook: [`{notebook.name}`]({notebook.name}).\n"
        write(target, normalize_lists(notebook_page(notebook, target) + link))
        shutil.copyfile(notebook, target.with_name(notebook.name))
        tutorials.append(f"tutorials/{target.name}")
    return nav(result, generated, tutorials)


def nav(result: dict[str, tuple[str, str]], generated: dict[str, str], notebooks: list[str]) -> list[Any]:
    """The navigation."""

    def rows(*sources: str) -> list[Any]:
        return [{result[source][1]: result[source][0]} for source in sources if source in result]

    def section(name: str) -> list[Any]:
        return rows(*(source for source in result if source.startswith(f"docs/{name}/")))

    first = [f"python/{name}.md" for name in PAGES]
    rest = sorted(page for page in generated if page.startswith("python/") and page not in first)
    http = [page for page in generated if page.startswith("http/") and page not in ("http/index.md", "http/schemas.md")]
    return [
        {"Start": ["index.md", *rows("docs/gallery/index.md", "docs/glossary.md")]},
        {"Tutorials": [*section("tutorials"), *notebooks]},
        {"How to": section("how-to")},
        {"Reference": [{"Command line": "commands.md"}, *section("reference"), *rows("SECURITY.md")]},
        {"Python": ["python/index.md", *first, *rest]},
        {"HTTP": ["http/index.md", *http, {"Schemas": "http/schemas.md"}]},
        {"Explanation": [*section("explanation"), *rows("docs/calibration.md")]},
        {"Benchmarks": section("benchmarks")},
        {"Project": rows(*PROJECT)},
    ]


def write(page: Path, text: str) -> None:
    """Writes a page, and creates its folders."""
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(text, encoding="utf-8")


def main() -> int:
    """Builds and checks the site. Returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=Path, required=True, help="the program, for its `--help`")
    binary = parser.parse_args().bin.resolve()
    if found := problems(ROOT, binary):
        print("\n".join(found), file=sys.stderr)
        return 1
    config = {"INHERIT": os.path.relpath(HERE / "mkdocs.yml", OUT), "nav": assemble(binary, OUT / "pages")}
    (OUT / "mkdocs.yml").write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
    # Suppresses the theme's notice about mkdocs 2, which is not used here.
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--config-file", str(OUT / "mkdocs.yml")]
    if code := subprocess.run(command, env=quiet).returncode:
        return code
    return subprocess.run([sys.executable, str(HERE / "check.py"), str(OUT / "site")]).returncode


if __name__ == "__main__":
    sys.exit(main())
