"""What the program is made of: crates, the standard library, and what crates and the page bring along."""

from __future__ import annotations

import html
import json
import re
import subprocess
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TEXTS = Path(__file__).resolve().parent / "texts"
#: Released for this; other Linux targets hold the same or less.
TARGET = "x86_64-unknown-linux-gnu"


@dataclass(frozen=True)
class Part:
    """One thing inside the program, with the licences it comes under."""

    name: str
    version: str
    #: SPDX expression.
    licence: str
    #: Package URL.
    purl: str
    #: Texts that have to go with it.
    texts: tuple[str, ...]


def crates() -> list[Part]:
    """Every crate the program is compiled from, macros included, sorted by name; what only builds or tests it is not."""
    command = ["cargo", "metadata", "--format-version=1", "--locked", "--filter-platform", TARGET]
    out = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    metadata = json.loads(out)
    packages = {package["id"]: package for package in metadata["packages"]}
    reached = _reached(metadata["resolve"])
    return sorted(
        (_crate(packages[key]) for key in reached if packages[key]["source"]),
        key=lambda part: (part.name, part.version),
    )


def standard_library() -> list[Part]:
    """Rust's standard library and what is linked with it, as the toolchain's own notice tells."""
    root = subprocess.run(["rustc", "--print", "sysroot"], check=True, capture_output=True, text=True).stdout.strip()
    documents = Path(root) / "share" / "doc" / "rust"
    page = (documents / "COPYRIGHT-library.html").read_text(encoding="utf-8")
    version = subprocess.run(["rustc", "--version"], check=True, capture_output=True, text=True).stdout.split()[1]
    own = (documents / "licenses" / "MIT.txt").read_text(encoding="utf-8")
    own = own.replace("<year> <copyright holders>", "The Rust Project Developers (https://thanks.rust-lang.org)")
    purl = f"pkg:generic/rust-std@{version}"
    return [Part("Rust standard library", version, "MIT OR Apache-2.0", purl, (own,)), *_within(page)]


def others() -> list[Part]:
    """What is inside crates and the page and is no crate itself."""
    return [_swagger_ui(), _fonts(), _sqlite(), _openapi_fetch()]


def _reached(resolve: dict[str, Any]) -> set[str]:
    nodes = {node["id"]: node for node in resolve["nodes"]}
    found: set[str] = set()
    ahead = [resolve["root"]]
    while ahead:
        key = ahead.pop()
        if key in found:
            continue
        found.add(key)
        # A kind of null is an ordinary dependency; "dev" and "build" do not end up in the program.
        ahead += [d["pkg"] for d in nodes[key]["deps"] if any(k["kind"] is None for k in d["dep_kinds"])]
    return found


_NOTICE = re.compile(r"(un)?licen[sc]e|copying|copyright|notice", re.IGNORECASE)


def _crate(package: dict[str, Any]) -> Part:
    directory = Path(package["manifest_path"]).parent
    files = {
        str(file.relative_to(directory)): file.read_text(encoding="utf-8", errors="replace")
        for file in sorted(_notices(directory))
    }
    if not files:
        files = _standing_in(package)
    name, version = package["name"], package["version"]
    licence = package["license"].replace("/", " OR ")
    return Part(name, version, licence, f"pkg:cargo/{name}@{version}", chosen(licence, files))


def _notices(directory: Path) -> Iterator[Path]:
    """Licences at the top of a crate and of what it carries of others'."""
    for place in (directory, *directory.glob("third_party/*")):
        if place.is_dir():
            yield from (file for file in place.iterdir() if file.is_file() and _NOTICE.match(file.name))


def _standing_in(package: dict[str, Any]) -> dict[str, str]:
    """The usual text for a crate that forgot to pack its own."""
    authors = ", ".join(package["authors"]) or f"the authors of {package['name']}"
    which = "MIT" if "MIT" in package["license"] else package["license"]
    text = (TEXTS / f"{which}.txt").read_text(encoding="utf-8")
    return {which: text.replace("<year> <copyright holders>", authors)}


def chosen(licence: str, files: dict[str, str]) -> tuple[str, ...]:
    """The texts that have to go along: where one may choose MIT, Apache's text need not.

    Notices stay in any case.
    """
    alternatives = re.split(r"\s+OR\s+", licence)
    if "AND" in licence or "MIT" not in alternatives:
        return tuple(files.values())
    mit = [text for text in files.values() if "Permission is hereby granted, free of charge" in text]
    if not mit:
        return tuple(files.values())
    return (*mit, *(text for name, text in files.items() if "notice" in name.lower() and text not in mit))


#: What of the standard library's dependencies is linked on Linux.
_LINKED = {"cfg-if", "foldhash", "gimli", "hashbrown", "libc", "rustc-demangle"}


def _within(page: str) -> Iterator[Part]:
    for block in page.split("<h3>")[1:]:
        heading = re.match(r"\W*([\w-]+?)-(\d[\w.+-]*)</h3>", block)
        licence = re.search(r"<b>License:</b> ([^<]+)</p>", block)
        if heading is None or licence is None or heading[1] not in _LINKED:
            continue
        found = re.findall(r"<code>([^<]+)</code></summary>\s*<pre>(.*?)</pre>", block, re.DOTALL)
        expression = licence[1].strip().replace("/", " OR ")
        files = {name: html.unescape(text) for name, text in found}
        purl = f"pkg:cargo/{heading[1]}@{heading[2]}"
        yield Part(f"{heading[1]} (in the standard library)", heading[2], expression, purl, chosen(expression, files))


def _source(crate: str) -> Path:
    """Where Cargo has unpacked a crate that we depend on."""
    command = ["cargo", "metadata", "--format-version=1", "--locked", "--filter-platform", TARGET]
    out = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    found = [p["manifest_path"] for p in json.loads(out)["packages"] if p["name"] == crate]
    return Path(found[0]).parent


def _swagger_ui() -> Part:
    (archive,) = (_source("utoipa-swagger-ui-vendored") / "res").glob("v*.zip")
    version = archive.stem.removeprefix("v")
    with zipfile.ZipFile(archive) as packed:
        own = [packed.read(f"swagger-ui-{version}/{name}").decode() for name in ("NOTICE", "LICENSE")]
    # The archive leaves out what its bundle's first line refers to; its package on npm has it.
    within = (TEXTS / "swagger-ui-bundle.txt").read_text(encoding="utf-8")
    return Part("swagger-ui", version, "Apache-2.0", f"pkg:npm/swagger-ui-dist@{version}", (*own, within))


def _fonts() -> Part:
    (directory,) = (_source("dejavu") / "assets").glob("dejavu-fonts-ttf-*")
    version = directory.name.rpartition("-")[2]
    text = (directory / "LICENSE").read_text(encoding="utf-8", errors="replace")
    return Part("DejaVu fonts", version, "Bitstream-Vera", f"pkg:generic/dejavu-fonts@{version}", (text,))


def _sqlite() -> Part:
    header = (_source("libsqlite3-sys") / "sqlite3" / "sqlite3.h").read_text(encoding="utf-8", errors="replace")
    found = re.search(r'#define SQLITE_VERSION\s+"([^"]+)"', header)
    assert found is not None, "sqlite3.h says its version"
    text = "The author disclaims copyright to this source code: SQLite is in the public domain (https://sqlite.org/copyright.html)."
    return Part("SQLite", found[1], "blessing", f"pkg:generic/sqlite@{found[1]}", (text,))


def _openapi_fetch() -> Part:
    lock = json.loads((ROOT / "web" / "package-lock.json").read_text(encoding="utf-8"))
    row = lock["packages"]["node_modules/openapi-fetch"]
    text = (TEXTS / "openapi-fetch.txt").read_text(encoding="utf-8")
    return Part("openapi-fetch", row["version"], row["license"], f"pkg:npm/openapi-fetch@{row['version']}", (text,))
