"""The pages: puts together what they are made of, builds them, holds them to it.

    python docs/site/build.py --bin target/debug/iplw        out/pages -> out/site; any warning fails

| part | from |
|---|---|
| documents | `docs/*.md`, `CHANGELOG.md`, `SECURITY.md`, ... as they are; links led to the pages (`links.py`) |
| Python | docstrings, read without importing anything (`python_pages.py`, `comments.py`) |
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
from diagrams import DRAWN, pictured
from http_pages import http_pages
from links import Links
from markdown_text import four_spaces
from notebooks import notebook_page
from python_pages import PAGES, python_pages

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
OUT = ROOT / "out"
SOURCES = ROOT / "clients" / "python" / "src"

#: Path in the repository -> path on the pages, heading in the list. What else is in `docs/` comes after them.
DOCUMENTS: dict[str, tuple[str, str]] = {
    "docs/install.md": ("install.md", "Installing"),
    "clients/python/README.md": ("python/index.md", "Guide"),
    "docs/environments.md": ("environments.md", "Spaces, as tables"),
    "docs/formats.md": ("formats.md", "Files"),
    "docs/zeromq.md": ("zeromq.md", "ZeroMQ"),
    "docs/openenv.md": ("openenv.md", "OpenEnv"),
    "docs/agents.md": ("agents.md", "Agents (MCP)"),
    "docs/limits.md": ("limits.md", "Limits"),
    "SECURITY.md": ("security.md", "Security"),
    "docs/figures.md": ("figures.md", "Figures"),
    "docs/results/README.md": ("results.md", "Results"),
    "docs/agents_over_families.md": ("agents_over_families.md", "Agents over families"),
    "docs/architecture.md": ("architecture.md", "The map"),
    "docs/extending.md": ("extending.md", "How to add things"),
    "web/README.md": ("web.md", "The page"),
    "CONTRIBUTING.md": ("contributing.md", "Contributing"),
    "CHANGELOG.md": ("changelog.md", "Changelog"),
}
START = ("docs/install.md",)
PYTHON = ("docs/environments.md",)
AGENTS = ("docs/openenv.md", "docs/agents.md")
SERVER = ("docs/formats.md", "docs/zeromq.md", "docs/limits.md", "SECURITY.md")
EVIDENCE = ("docs/figures.md", "docs/results/README.md", "docs/agents_over_families.md")
PROJECT = ("docs/architecture.md", "docs/extending.md", "web/README.md", "CONTRIBUTING.md", "CHANGELOG.md")


def documents() -> dict[str, tuple[str, str]]:
    """Every document, those that nobody placed included."""
    found = dict(DOCUMENTS)
    for file in sorted((ROOT / "docs").glob("*.md")):
        found.setdefault(f"docs/{file.name}", (file.name, file.stem.replace("_", " ").capitalize()))
    return {source: page for source, page in found.items() if (ROOT / source).is_file()}


def assemble(binary: Path, pages: Path) -> list[Any]:
    """Writes the pages' sources; the list of them as mkdocs has it (`nav`)."""
    shutil.rmtree(pages, ignore_errors=True)
    shutil.copytree(HERE / "pages", pages)
    shutil.copytree(DRAWN, pages / "diagrams")
    found = documents()
    links = Links(ROOT, pages, {source: page for source, (page, _) in found.items()})
    for source, (page, _) in found.items():
        text = links.moved((ROOT / source).read_text(encoding="utf-8"), source, page)
        write(pages / page, four_spaces(pictured(text, "../" * page.count("/"))))
    made = python_pages(SOURCES)
    made |= http_pages(json.loads((ROOT / "openapi" / "openapi.json").read_text(encoding="utf-8")))
    made["commands.md"] = commands_page(binary)
    for page, text in made.items():
        write(pages / page, text)
    (pages / "files" / "openapi").mkdir(parents=True, exist_ok=True)
    shutil.copyfile(ROOT / "openapi" / "openapi.json", pages / "files" / "openapi" / "openapi.json")
    tutorials = []
    for notebook in sorted((ROOT / "examples" / "notebooks").glob("*.ipynb")):
        there = pages / "tutorials" / f"{notebook.stem}.md"
        # The file itself lies beside its page, to be taken along.
        whole = f"\n[`{notebook.name}`]({notebook.name}) is this page as a notebook, to be run.\n"
        write(there, four_spaces(notebook_page(notebook, there) + whole))
        shutil.copyfile(notebook, there.with_name(notebook.name))
        tutorials.append(f"tutorials/{there.name}")
    return nav(found, made, tutorials)


def nav(found: dict[str, tuple[str, str]], made: dict[str, str], tutorials: list[str]) -> list[Any]:
    """The list of pages."""

    def rows(*sources: str) -> list[Any]:
        return [{found[source][1]: found[source][0]} for source in sources if source in found]

    first = [f"python/{name}.md" for name in PAGES]
    rest = sorted(page for page in made if page.startswith("python/") and page not in first)
    http = [page for page in made if page.startswith("http/") and page not in ("http/index.md", "http/schemas.md")]
    placed = {*START, *PYTHON, *AGENTS, *SERVER, *EVIDENCE, *PROJECT, "clients/python/README.md"}
    return [
        {"Start": ["index.md", *rows(*START)]},
        *([{"Tutorials": tutorials}] if tutorials else []),
        {"Python": ["python/index.md", *rows(*PYTHON), *first, *rest]},
        {"HTTP": ["http/index.md", *http, {"Schemas": "http/schemas.md"}]},
        {"Command line": "commands.md"},
        {"Agents": rows(*AGENTS)},
        {"Formats and server": [*rows(*SERVER), *rows(*(source for source in found if source not in placed))]},
        {"Figures": rows(*EVIDENCE)},
        {"Project": rows(*PROJECT)},
    ]


def write(page: Path, text: str) -> None:
    """Writes a page and the folders above it."""
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(text, encoding="utf-8")


def main() -> int:
    """Builds and checks; not 0 if anything is wrong."""
    given = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    given.add_argument("--bin", type=Path, required=True, help="the program, for what its commands say")
    binary = given.parse_args().bin.resolve()
    made = {"INHERIT": os.path.relpath(HERE / "mkdocs.yml", OUT), "nav": assemble(binary, OUT / "pages")}
    (OUT / "mkdocs.yml").write_text(yaml.safe_dump(made, sort_keys=False), encoding="utf-8")
    # The theme's authors tell in every build what they think of mkdocs 2, which is not used here.
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--config-file", str(OUT / "mkdocs.yml")]
    if code := subprocess.run(command, env=quiet).returncode:
        return code
    return subprocess.run([sys.executable, str(HERE / "check.py"), str(OUT / "site")]).returncode


if __name__ == "__main__":
    sys.exit(main())
