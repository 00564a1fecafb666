"""Where links of the repository's documents lead on the pages."""

from __future__ import annotations

import os
import posixpath
import shutil
from pathlib import Path

from markdown_text import CODE, LINK, outside_fences

#: Largest file that is put beside the pages because a document links to it, bytes.
LARGEST = 2_000_000


class Links:
    """Documents and files of the repository, and where they are on the pages."""

    def __init__(self, root: Path, out: Path, pages: dict[str, str]) -> None:
        """`pages`: path in the repository -> path on the pages."""
        self._root, self._out, self._pages = root, out, pages

    def rewrite(self, text: str, source: str, page: str) -> str:
        """A document's text with its links, and paths in code that name other documents, rewritten for the pages."""

        def links(prose: str) -> str:
            prose = LINK.sub(lambda result: f"{result[1]}({self._led(result[2], source, page)})", prose)
            return CODE.sub(lambda result: self._named(result[1], result[0], page), prose)

        return outside_fences(text, links)

    def _led(self, address: str, source: str, page: str) -> str:
        path, mark, anchor = address.partition("#")
        if "://" in address or not path or address.startswith("mailto:"):
            return address
        target = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        return _relative(self._pages.get(target) or self._file(target, source), page) + mark + anchor

    def _file(self, path: str, source: str) -> str:
        """A file that is no page, put beside them."""
        file = self._root / path
        if not file.is_file() or file.stat().st_size > LARGEST:
            raise SystemExit(f"{source}: a link leads to {path}, which is no file of at most {LARGEST} bytes")
        target = self._out / "files" / path
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
        return f"files/{path}"

    def _named(self, name: str, as_it_was: str, page: str) -> str:
        target = self._pages.get(name)
        return as_it_was if target is None or target == page else f"[{as_it_was}]({_relative(target, page)})"


def _relative(path: str, page: str) -> str:
    return Path(os.path.relpath(path, posixpath.dirname(page) or ".")).as_posix()
