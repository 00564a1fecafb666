"""What builds the pages, and what holds them to it, against faults that were put there. `make test-docs`."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import griffe
import markdown
import pytest

from check import Found, untold, wrong
from comments import said
from commands import ROW
from http_pages import http_pages, operations
from links import Links
from markdown_text import four_spaces
from notebooks import notebook_page
from python_pages import public, python_pages

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "clients" / "python" / "src"


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ('<a href="nowhere.html">x</a>', "nowhere.html leads to no file"),
        ('<a href="b.html#gone">x</a>', "b.html#gone leads to no place"),
        ('<a href="#gone">x</a>', "#gone leads to no place"),
        ('<img src="gone.png">', "gone.png leads to no file"),
        ('<script src="https://unpkg.com/x.js"></script>', "loads https://unpkg.com/x.js"),
        ('<link rel="stylesheet" href="//fonts.example/css">', "loads //fonts.example/css"),
        ('<img src="https://img.example/badge.svg">', "loads https://img.example/badge.svg"),
        ('<p style="background: url(https://img.example/a.png)">', "loads https://img.example/a.png"),
        ("<p>see [this](formats.md)</p>", "Markdown that was not understood"),
        ("<p>| a | b | | --- | --- |</p>", "Markdown that was not understood"),
    ],
)
def test_faults_of_a_page_are_found(tmp_path: Path, body: str, says: str) -> None:
    (tmp_path / "a.html").write_text(f"<html><body>{body}</body></html>")
    (tmp_path / "b.html").write_text('<html><body id="here"></body></html>')
    found = list(wrong(tmp_path))
    assert len(found) == 1 and says in found[0]


def test_a_page_without_faults_has_none(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<link rel="canonical" href="https://x.example/"><a href="b.html#here">x</a><a href="https://w3.org/#y">y</a>'
        "<code>[this](formats.md)</code><a href='#top' id='top'>z</a>"
    )
    (tmp_path / "b.html").write_text('<p id="here"></p>')
    assert list(wrong(tmp_path)) == []


def test_css_that_loads_from_elsewhere_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.css").write_text("@import 'https://fonts.example/x.css'; p {background: url(own.png)}")
    assert list(wrong(tmp_path)) == ["a.css: loads https://fonts.example/x.css"]


def test_a_public_name_on_no_page_is_found(tmp_path: Path) -> None:
    (tmp_path / "python").mkdir()
    assert "iplw.Client is on no page" in list(untold(tmp_path, SOURCES))
    assert "iplw.openenv.IplwEnv is on no page" in list(untold(tmp_path, SOURCES))


def test_every_public_name_has_its_place() -> None:
    text = "".join(python_pages(SOURCES).values())
    for name in public(SOURCES / "iplw" / "__init__.py"):
        assert name.startswith("Async") or f"::: iplw.{name}\n" in text


def test_every_operation_and_schema_has_its_place() -> None:
    document = json.loads((ROOT / "openapi" / "openapi.json").read_text())
    pages = http_pages(document)
    for _, path, said in operations(document):
        assert all(f"{{#{said['operationId']}}}" in pages[f"http/{tag}.md"] for tag in said["tags"])
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
def test_lists_and_tables_as_github_takes_them_are_understood(text: str, html: list[str]) -> None:
    made = markdown.markdown(four_spaces(text), extensions=["tables", "sane_lists", "fenced_code"])
    flat = re.sub(r"</?p>|(?<=<li>)\n|\n(?=</li>|<ul>)", "", made)
    assert all(part in flat for part in html), made


def test_links_lead_to_pages_and_to_files_beside_them(tmp_path: Path) -> None:
    (tmp_path / "repo" / "docs").mkdir(parents=True)
    (tmp_path / "repo" / "openapi.json").write_text("{}")
    pages = {"docs/a.md": "a.md", "README.md": "python/index.md"}
    links = Links(tmp_path / "repo", tmp_path / "out", pages)
    text = "[x](docs/a.md#part) `docs/a.md` [y](openapi.json) [z](https://w3.org)\n```\n[x](docs/a.md)\n```\n"
    assert links.moved(text, "README.md", "python/index.md") == (
        "[x](../a.md#part) [`docs/a.md`](../a.md) [y](../files/openapi.json) [z](https://w3.org)\n```\n[x](docs/a.md)\n```\n"
    )
    assert (tmp_path / "out" / "files" / "openapi.json").is_file()
    with pytest.raises(SystemExit, match="README.md: a link leads to gone.md"):
        links.moved("[x](gone.md)", "README.md", "python/index.md")


def test_comments_speak_of_the_attribute_below_or_beside_them() -> None:
    lines = ["#: (n,) times, s;", "#: from 0.", "t: int", "x: int  #: beside, m", "y: int"]
    assert [said(lines, i) for i in (2, 3, 4)] == ["(n,) times, s;\nfrom 0.", "beside, m", ""]
    reading = griffe.load_extensions(str(Path(__file__).with_name("comments.py")))
    package = griffe.load("iplw", search_paths=[str(SOURCES)], extensions=reading)
    spoken = {"rollout.Rollout.bodies": "m, and angle, rad", "openenv.models.IplwObservation.valid": "could be placed"}
    for path, words in spoken.items():
        docstring = package[path].docstring
        assert docstring is not None and words in docstring.value


def test_a_notebooks_text_code_and_outputs_become_a_page(tmp_path: Path) -> None:
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


def test_commands_of_a_list_are_found() -> None:
    listed = "  run         The story\n  token       Make\n      --not  One\n  help        Print"
    assert ROW.findall(listed) == ["run", "token", "help"]


def test_anchors_and_what_is_verbatim_are_told_apart() -> None:
    page = Found('<h2 id="a">x</h2><pre>](</pre><p>](</p>')
    assert page.anchors == {"a"} and page.left == ["]("]
