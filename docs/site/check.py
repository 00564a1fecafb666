"""Checks the built site: links and anchors resolve, no external resources are loaded, all public names are documented.

    python docs/site/check.py SITE
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

#: Elements and their attributes that load resources.
RESOURCE_ATTRIBUTES = {
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
#: Values of `<link rel=...>` that load nothing.
METADATA_LINKS = {"canonical", "next", "prev", "license", "alternate"}
#: Elements with verbatim text.
VERBATIM = {"pre", "code", "script", "style", "textarea"}
#: Markdown syntax in rendered text: a link, a fence, a table row, emphasis.
RAW_MARKDOWN = re.compile(r"\]\(|```|\|\s*-{3,}\s*\||\*\*\w|^:::")
CSS = re.compile(r"""(?:url\(|@import)\s*["']?((?:https?:)?//[^"')\s]+)""")


class PageParser(HTMLParser):
    """Anchors, links and loaded resources of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.resources: list[str] = []
        #: Markdown that was not rendered.
        self.raw_markdown: list[str] = []
        self._verbatim = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        self.anchors |= {values[name] for name in ("id", "name") if values.get(name)}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        for name in RESOURCE_ATTRIBUTES.get(tag, ()):
            if name in values:
                self.resources.append(values[name])
        if tag == "link" and not set(values.get("rel", "").split()) & METADATA_LINKS:
            self.resources.append(values.get("href", ""))
        self.resources += CSS.findall(values.get("style", ""))
        self._verbatim += tag in VERBATIM

    def handle_endtag(self, tag: str) -> None:
        self._verbatim -= tag in VERBATIM

    def handle_data(self, data: str) -> None:
        if not self._verbatim and (result := RAW_MARKDOWN.search(data)):
            self.raw_markdown.append(data[max(0, result.start() - 30) : result.end() + 30].strip())


def page_errors(site: Path) -> Iterator[str]:
    """Errors of all pages, one line each."""
    pages = {file: PageParser(file.read_text(encoding="utf-8")) for file in sorted(site.rglob("*.html"))}
    for file, page in pages.items():
        name = file.relative_to(site)
        for address in page.resources:
            if urlsplit(address).netloc:
                yield f"{name}: loads {address}"
            elif not address.startswith("data:"):
                yield from _link_errors(site, file, address, pages)
        for text in page.raw_markdown:
            yield f"{name}: unrendered Markdown: {text!r}"
        for address in page.links:
            yield from _link_errors(site, file, address, pages)
    for file in sorted(site.rglob("*.css")):
        for address in CSS.findall(file.read_text(encoding="utf-8")):
            yield f"{file.relative_to(site)}: loads {address}"


def _link_errors(site: Path, file: Path, address: str, pages: dict[Path, PageParser]) -> Iterator[str]:
    """Reports an address within the site that does not resolve."""
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
        yield f"{file.relative_to(site)}: {address} is a broken link"
    elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors | THEME_FRAGMENTS:
        yield f"{file.relative_to(site)}: {address} has no such anchor"


#: Fragments that select the colour scheme of a picture.
THEME_FRAGMENTS = {"only-light", "only-dark"}


def undocumented(site: Path, sources: Path) -> Iterator[str]:
    """Public Python names on no page, and those without a docstring."""
    import griffe

    from python_pages import ASYNC_PREFIX, CLIENT_PACKAGES, PACKAGE, public

    anchors = {a for file in (site / "python").glob("*.html") for a in PageParser(file.read_text(encoding="utf-8")).anchors}
    package = griffe.load(PACKAGE, search_paths=[str(sources)])
    for file in [sources / PACKAGE / "__init__.py", *sorted((sources / PACKAGE).glob("*/__init__.py"))]:
        prefix = "" if file.parent.name == PACKAGE else f"{file.parent.name}."
        if prefix.rstrip(".") in CLIENT_PACKAGES:
            continue
        for name in public(file):
            if not name.startswith(ASYNC_PREFIX) and f"{PACKAGE}.{prefix}{name}" not in anchors:
                yield f"{PACKAGE}.{prefix}{name} is on no page"
            yield from _missing_docstrings(package[f"{prefix}{name}"])


def _missing_docstrings(item: object) -> Iterator[str]:
    import griffe

    assert isinstance(item, (griffe.Object, griffe.Alias))
    target = item.final_target if isinstance(item, griffe.Alias) else item
    assert isinstance(target, griffe.Object)
    if target.docstring is None and not target.is_attribute:
        yield f"{target.path} has no docstring"
    if target.is_class:
        for name, member in target.members.items():
            if not name.startswith("_") and not member.is_alias and (member.is_function or member.is_class):
                yield from _missing_docstrings(member)


def main() -> int:
    """Prints all errors; returns 1 if there are any."""
    site = Path(sys.argv[1]).resolve()
    result = [*page_errors(site), *undocumented(site, Path(__file__).resolve().parents[2] / "clients" / "python" / "src")]
    for line in result:
        print(line, file=sys.stderr)
    print(f"{len(list(site.rglob('*.html')))} pages, {len(result)} errors")
    return 1 if result else 0


if __name__ == "__main__":
    sys.exit(main())
