"""Holds built pages to it: links and anchors lead somewhere, nobody else is asked for anything, all that is public is told.

    python docs/site/check.py SITE
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

#: Elements and the attributes by which a page has something loaded.
LOADS = {
    "script": ("src",),
    "img": ("src", "srcset"),
    "iframe": ("src",),
    "source": ("src", "srcset"),
    "video": ("src", "poster"),
    "audio": ("src",),
    "embed": ("src",),
    "object": ("data",),
    "use": ("href", "xlink:href"),
    "image": ("href", "xlink:href"),
}
#: `<link rel=...>` that only tells, and loads nothing.
TELLS = {"canonical", "next", "prev", "license", "alternate"}
#: Elements whose text is as it is.
VERBATIM = {"pre", "code", "script", "style", "textarea"}
#: Markdown in what is read: a link, a fence, a row of a table, emphasis.
LEFT = re.compile(r"\]\(|```|\|\s*-{3,}\s*\||\*\*\w|^:::")
CSS = re.compile(r"""(?:url\(|@import)\s*["']?((?:https?:)?//[^"')\s]+)""")


class Found(HTMLParser):
    """What a page holds: anchors, links, what it has loaded."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        #: Markdown that was not understood.
        self.left: list[str] = []
        self._verbatim = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        self.anchors |= {values[name] for name in ("id", "name") if values.get(name)}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        for name in LOADS.get(tag, ()):
            if name in values:
                self.loads.append(values[name])
        if tag == "link" and not set(values.get("rel", "").split()) & TELLS:
            self.loads.append(values.get("href", ""))
        self.loads += CSS.findall(values.get("style", ""))
        self._verbatim += tag in VERBATIM

    def handle_endtag(self, tag: str) -> None:
        self._verbatim -= tag in VERBATIM

    def handle_data(self, data: str) -> None:
        if not self._verbatim and (result := LEFT.search(data)):
            self.left.append(data[max(0, result.start() - 30) : result.end() + 30].strip())


def invalid(site: Path) -> Iterator[str]:
    """What is wrong, a line each."""
    pages = {file: Found(file.read_text(encoding="utf-8")) for file in sorted(site.rglob("*.html"))}
    for file, page in pages.items():
        name = file.relative_to(site)
        for address in page.loads:
            if urlsplit(address).netloc:
                yield f"{name}: loads {address}"
            elif not address.startswith("data:"):
                yield from _leads(site, file, address, pages)
        for text in page.left:
            yield f"{name}: Markdown that was not understood: {text!r}"
        for address in page.links:
            yield from _leads(site, file, address, pages)
    for file in sorted(site.rglob("*.css")):
        for address in CSS.findall(file.read_text(encoding="utf-8")):
            yield f"{file.relative_to(site)}: loads {address}"


def _leads(site: Path, file: Path, address: str, pages: dict[Path, Found]) -> Iterator[str]:
    """Says if an address within the site leads nowhere."""
    parts = urlsplit(address)
    if parts.scheme or parts.netloc:
        return
    path = unquote(parts.path)
    target = site / path.lstrip("/") if path.startswith("/") else file.parent / path if path else file
    target = target.resolve()
    if target.is_dir():
        target /= "index.html"
    if file.name == "404.html":
        return
    if not target.is_file():
        yield f"{file.relative_to(site)}: {address} leads to no file"
    elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors | ONLY:
        yield f"{file.relative_to(site)}: {address} leads to no place on that page"


#: Fragments that say when a picture is shown.
ONLY = {"only-light", "only-dark"}


def untold(site: Path, sources: Path) -> Iterator[str]:
    """Public names of Python that no page tells, and those that have nothing to say for themselves."""
    import griffe

    from python_pages import AWAITED, INSIDE, PACKAGE, public

    anchors = {a for file in (site / "python").glob("*.html") for a in Found(file.read_text(encoding="utf-8")).anchors}
    package = griffe.load(PACKAGE, search_paths=[str(sources)])
    for file in [sources / PACKAGE / "__init__.py", *sorted((sources / PACKAGE).glob("*/__init__.py"))]:
        within = "" if file.parent.name == PACKAGE else f"{file.parent.name}."
        if within.rstrip(".") in INSIDE:
            continue
        for name in public(file):
            if not name.startswith(AWAITED) and f"{PACKAGE}.{within}{name}" not in anchors:
                yield f"{PACKAGE}.{within}{name} is on no page"
            yield from _silent(package[f"{within}{name}"])


def _silent(item: object) -> Iterator[str]:
    import griffe

    assert isinstance(item, (griffe.Object, griffe.Alias))
    target = item.final_target if isinstance(item, griffe.Alias) else item
    assert isinstance(target, griffe.Object)
    if target.docstring is None and not target.is_attribute:
        yield f"{target.path} has no docstring"
    if target.is_class:
        for name, member in target.members.items():
            if not name.startswith("_") and not member.is_alias and (member.is_function or member.is_class):
                yield from _silent(member)


def main() -> int:
    """Prints what is wrong; 1 if anything is."""
    site = Path(sys.argv[1]).resolve()
    result = [*invalid(site), *untold(site, Path(__file__).resolve().parents[2] / "clients" / "python" / "src")]
    for line in result:
        print(line, file=sys.stderr)
    print(f"{len(list(site.rglob('*.html')))} pages, {len(result)} things wrong")
    return 1 if result else 0


if __name__ == "__main__":
    sys.exit(main())
