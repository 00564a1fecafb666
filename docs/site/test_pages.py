"""Tests of the build of the site and of its checks, with deliberate errors. `make test-docs`."""

from __future__ import annotations

import base64
import json
import re
import subprocess
import sys
from pathlib import Path

import griffe
import markdown
import pytest

from check import PageParser, page_errors, undocumented
from comments import comment_of
from commands import COMMAND_ROW
from check_documents import blocks, call_error, calls, documents, matches, name_errors, problems
from http_pages import http_pages, operations
from links import Links
from markdown_text import normalize_lists
from notebooks import notebook_page
from python_pages import public, python_pages

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "clients" / "python" / "src"


@pytest.mark.parametrize(
    ("body", "error"),
    [
        ('<a href="nowhere.html">x</a>', "nowhere.html is a broken link"),
        ('<a href="b.html#gone">x</a>', "b.html#gone has no such anchor"),
        ('<a href="#gone">x</a>', "#gone has no such anchor"),
        ('<img src="gone.png">', "gone.png is a broken link"),
        ('<script src="https://unpkg.com/x.js"></script>', "loads https://unpkg.com/x.js"),
        ('<link rel="stylesheet" href="//fonts.example/css">', "loads //fonts.example/css"),
        ('<img src="https://img.example/badge.svg">', "loads https://img.example/badge.svg"),
        ('<p style="background: url(https://img.example/a.png)">', "loads https://img.example/a.png"),
        ("<p>see [this](formats.md)</p>", "unrendered Markdown"),
        ("<p>| a | b | | --- | --- |</p>", "unrendered Markdown"),
    ],
)
def test_errors_of_a_page_are_reported(tmp_path: Path, body: str, error: str) -> None:
    (tmp_path / "a.html").write_text(f"<html><body>{body}</body></html>")
    (tmp_path / "b.html").write_text('<html><body id="here"></body></html>')
    result = list(page_errors(tmp_path))
    assert len(result) == 1 and error in result[0]


def test_a_valid_page_has_no_errors(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<link rel="canonical" href="https://x.example/"><a href="b.html#here">x</a><a href="https://w3.org/#y">y</a>'
        "<code>[this](formats.md)</code><a href='#top' id='top'>z</a>"
    )
    (tmp_path / "b.html").write_text('<p id="here"></p>')
    assert list(page_errors(tmp_path)) == []


def test_external_css_is_reported(tmp_path: Path) -> None:
    (tmp_path / "a.css").write_text("@import 'https://fonts.example/x.css'; p {background: url(own.png)}")
    assert list(page_errors(tmp_path)) == ["a.css: loads https://fonts.example/x.css"]


def test_an_undocumented_public_name_is_reported(tmp_path: Path) -> None:
    (tmp_path / "python").mkdir()
    assert "iplw.Client is on no page" in list(undocumented(tmp_path, SOURCES))
    assert "iplw.openenv.IplwEnv is on no page" in list(undocumented(tmp_path, SOURCES))


def test_every_public_name_is_on_a_page() -> None:
    text = "".join(python_pages(SOURCES).values())
    for name in public(SOURCES / "iplw" / "__init__.py"):
        assert name.startswith("Async") or f"::: iplw.{name}\n" in text


def test_every_operation_and_schema_is_on_a_page() -> None:
    document = json.loads((ROOT / "openapi" / "openapi.json").read_text())
    pages = http_pages(document)
    for _, path, operation in operations(document):
        assert all(f"{{#{operation['operationId']}}}" in pages[f"http/{tag}.md"] for tag in operation["tags"])
        assert path in pages["http/index.md"]
    assert all(f"{{#{name.lower()}}}" in pages["http/schemas.md"] for name in document["components"]["schemas"])


@pytest.mark.parametrize(
    ("text", "html"),
    [
        ("said:\n- one\n- two\n", ["<li>one</li>", "<li>two</li>"]),
        ("- one\n  - within\n- two\n", ["<li>one<ul>", "<li>within</li>"]),
        ("1. one\n\n   said of it\n\n   | a | b |\n   |---|---|\n   | 1 | 2 |\n2. two\n", ["<ol>", "<td>2</td>", "said of"]),
        ("- one\n  goes on\n", ["<li>one\n    goes on</li>"]),
        ("1. one\n\n```sh\n- no item\n```\n\n2. two\n", ["- no item"]),
        ("text\n| a | b |\n|---|---|\n| 1 | 2 |\n", ["<td>1</td>"]),
    ],
)
def test_lists_and_tables_of_github_markdown_are_rendered(text: str, html: list[str]) -> None:
    created = markdown.markdown(normalize_lists(text), extensions=["tables", "sane_lists", "fenced_code"])
    flat = re.sub(r"</?p>|(?<=<li>)\n|\n(?=</li>|<ul>)", "", created)
    assert all(part in flat for part in html), created


def test_links_are_rewritten_to_pages_and_copied_files(tmp_path: Path) -> None:
    (tmp_path / "repo" / "docs").mkdir(parents=True)
    (tmp_path / "repo" / "openapi.json").write_text("{}")
    pages = {"docs/a.md": "a.md", "README.md": "python/index.md"}
    links = Links(tmp_path / "repo", tmp_path / "out", pages)
    text = "[x](docs/a.md#part) `docs/a.md` [y](openapi.json) [z](https://w3.org)\n```\n[x](docs/a.md)\n```\n"
    assert links.rewrite(text, "README.md", "python/index.md") == (
        "[x](../a.md#part) [`docs/a.md`](../a.md) [y](../files/openapi.json) [z](https://w3.org)\n```\n[x](docs/a.md)\n```\n"
    )
    assert (tmp_path / "out" / "files" / "openapi.json").is_file()
    with pytest.raises(SystemExit, match="README.md: the target of a link, gone.md"):
        links.rewrite("[x](gone.md)", "README.md", "python/index.md")


def test_comments_above_or_after_an_attribute_document_it() -> None:
    lines = ["#: (n,) times, s;", "#: from 0.", "t: int", "x: int  #: beside, m", "y: int"]
    assert [comment_of(lines, i) for i in (2, 3, 4)] == ["(n,) times, s;\nfrom 0.", "beside, m", ""]
    reading = griffe.load_extensions(str(Path(__file__).with_name("comments.py")))
    package = griffe.load("iplw", search_paths=[str(SOURCES)], extensions=reading)
    expected = {"rollout.Rollout.bodies": "m, and angle, rad", "openenv.models.IplwObservation.valid": "could be placed"}
    for path, words in expected.items():
        docstring = package[path].docstring
        assert docstring is not None and words in docstring.value


def test_a_page_has_the_notebooks_text_code_and_outputs(tmp_path: Path) -> None:
    png = base64.b64encode(b"\x89PNG").decode()
    cells = [
        {"cell_type": "markdown", "source": ["# Play\n", "words"]},
        {
            "cell_type": "code",
            "source": "print(1)",
            "outputs": [
                {"output_type": "stream", "name": "stdout", "text": ["1\n"]},
                {"output_type": "stream", "name": "stderr", "text": ["a bar\n"]},
                {"output_type": "display_data", "data": {"image/png": png, "text/plain": "<Figure>"}},
                {"output_type": "execute_result", "data": {"text/html": "<b>3</b>", "text/plain": "3"}},
                {"output_type": "error", "traceback": ["\x1b[31mValueError\x1b[0m"]},
            ],
        },
        {"cell_type": "code", "source": "", "outputs": []},
    ]
    file = tmp_path / "play.ipynb"
    file.write_text(json.dumps({"cells": cells}))
    text = notebook_page(file, tmp_path / "pages" / "play.md")
    assert text.startswith("# Play\nwords\n\n```python\nprint(1)\n```\n\n```text\n1\n```")
    assert "![output](play-1-2.png)" in text and "<b>3</b>" in text and "```text\nValueError\n```" in text
    assert "a bar" not in text and "Figure" not in text
    assert (tmp_path / "pages" / "play-1-2.png").read_bytes() == b"\x89PNG"


def test_commands_of_a_list_are_parsed() -> None:
    listed = "  run         The story\n  token       Make\n      --not  One\n  help        Print"
    assert COMMAND_ROW.findall(listed) == ["run", "token", "help"]


def test_anchors_are_parsed_and_verbatim_text_is_ignored() -> None:
    page = PageParser('<h2 id="a">x</h2><pre>](</pre><p>](</p>')
    assert page.anchors == {"a"} and page.raw_markdown == ["]("]


HELPS = {
    ("diagnose",): "Options:\n  --trials <FILE>...\n  --out <DIR>",
    ("token",): "Commands:\n  new   Make",
    ("token", "new"): "Options:\n      --scope <SCOPE>\n      --data-dir <DIR>",
}


def test_calls_in_shell_blocks_and_inline_code_are_parsed() -> None:
    text = (
        "Use `iplw diagnose --out DIR`, not `iplw`.\n\n```sh\npip install iplw   # iplw\nA=1 ./target/release/iplw token new \\\n"
        "  ann --scope act && iplw check DIR > x\npython bench.py target/release/iplw measured\n```\n"
        "```python\niplw nothing\n```\n| `iplw plan [--prior \\| --seconds S]` |\n"
    )
    assert [call for call in calls(text) if call] == [
        "token new ann --scope act",
        "check DIR",
        "diagnose --out DIR",
        "plan [--prior | --seconds S]",
    ]


@pytest.mark.parametrize(
    ("call", "error"),
    [
        ("diagnose --trials a.csv --out DIR", None),
        ("diagnose --floor 0", "`iplw diagnose` has no --floor"),
        ("diagnosis --out DIR", "there is no command `iplw diagnosis`"),
        ("token new ann --scope act", None),
        ("token new ann --may act", "`iplw token new` has no --may"),
        ("token list --out DIR", "`iplw token` has no --out"),
        ("COMMAND --help", None),
        ("... --threads N", "no command has --threads"),
        ("", None),
    ],
)
def test_calls_are_checked_against_the_help(call: str, error: str | None) -> None:
    assert call_error(call, HELPS) == error


def test_missing_targets_and_paths_are_reported() -> None:
    text = "`make test`, `make nothing`, `src/lib.rs`, `src/gone.rs`, `src/effect/NAME.rs`, `cargo run --example gone`"
    result = list(name_errors(text, ROOT, {"test"}))
    assert result == ["there is no `make nothing`", "there is no examples/gone.rs", "there is no src/gone.rs"]


def test_checked_blocks_are_parsed_and_compared() -> None:
    text = "<!-- checked -->\n```console\n$ echo a \\\n  b\na b\n$ echo c\nc\n```\n```console\n$ not checked\n```\n"
    result = list(blocks(text))
    assert [(block.command, block.output) for block in result] == [("echo a   b", "a b"), ("echo c", "c")]
    assert matches("a\n...\nd", "a\nb \nc\nd\n") and matches("a  \n", "a") and not matches("a", "b") and not matches("a", "a\nb")


def test_an_incorrect_document_fails(tmp_path: Path) -> None:
    (tmp_path / "Makefile").write_text("test:\n")
    program = tmp_path / "iplw"
    program.write_text("#!/bin/sh\necho 'Usage: iplw'\n")
    program.chmod(0o755)
    (tmp_path / "README.md").write_text("`iplw gone`\n\n<!-- checked -->\n```console\n$ echo a\nb\n$ iplw\nUsage: iplw\n```\n")
    result = problems(tmp_path, program)
    assert len(result) == 2 and "there is no command `iplw gone`" in result[0] and "prints a different output" in result[1]


def test_documents_exist_for_every_kind() -> None:
    named = {file.relative_to(ROOT).as_posix() for file in documents(ROOT)}
    for kind in ("tutorials", "how-to", "reference", "explanation", "benchmarks"):
        assert any(name.startswith(f"docs/{kind}/") for name in named), kind


def test_benchmark_pages_match_their_results() -> None:
    check = [sys.executable, str(ROOT / "docs" / "benchmarks" / "render.py"), "--check"]
    done = subprocess.run(check, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
