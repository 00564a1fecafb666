"""Rewrites links between the repository's documents for the site."""

from __future__ import annotations

import os
import posixpath
import shutil
from pathlib import Path

from markdown_text import CODE, LINK, outside_fences

#: Maximum size of a linked file that is copied to the site, bytes.
MAX_FILE_SIZE = 2_000_000


class Links:
    """Maps documents and files of the repository to paths on the site."""

    def __init__(self, root: Path, out: Path, pages: dict[str, str]) -> None:
        """`pages`: path in the repository -> path on the site."""
        self._root, self._out, self._pages = root, out, pages

    def rewrite(self, text: str, source: str, page: str) -> str:
        """A document's text with its links, and inline code that is the path of another document, rewritten for the site."""

        def links(prose: str) -> str:
            prose = LINK.sub(lambda result: f"{result[1]}({self._link_target(result[2], source, page)})", prose)
            return CODE.sub(lambda result: self._linked_code(result[1], result[0], page), prose)

        return outside_fences(text, links)

    def _link_target(self, address: str, source: str, page: str) -> str:
        path, mark, anchor = address.partition("#")
        if "://" in address or not path or address.startswith("mailto:"):
            return address
        target = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        return _relative(self._pages.get(target) or self._file(target, source), page) + mark + anchor

    def _file(self, path: str, source: str) -> str:
        """Copies a file that is not a page to the site."""
        file = self._root / path
        if not file.is_file() or file.stat().st_size > MAX_FILE_SIZE:
            raise SystemExit(f"{source}: the target of a link, {path}, is not a file of at most {MAX_FILE_SIZE} bytes")
        target = self._out / "files" / path
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
        return f"files/{path}"

    def _linked_code(self, name: str, code: str, page: str) -> str:
        target = self._pages.get(name)
        return code if target is None or target == page else f"[{code}]({_relative(target, page)})"


def _relative(path: str, page: str) -> str:
    return Path(os.path.relpath(path, posixpath.dirname(page) or ".")).as_posix()
