"""What worlds, jobs and policies have in common: a handle on something the server keeps."""

from __future__ import annotations

from typing import Any, ClassVar

from typing_extensions import Self

from .http import Http, path


class Handle:
    """A handle on one resource. `data` is what the server last said about it."""

    #: Where such resources are, below `/v1/`.
    collection: ClassVar[str]

    def __init__(self, http: Http, data: dict[str, Any]) -> None:
        self._http = http
        self.data = data

    @property
    def id(self) -> str:
        """The resource's id."""
        return str(self.data["id"])

    def refresh(self) -> Self:
        """Looks again."""
        self.data = self._http.call("GET", self._path())
        return self

    def __repr__(self) -> str:
        words = [self.id, *(str(self.data[key]) for key in ("kind", "state") if isinstance(self.data.get(key), str))]
        return f"<iplw.{type(self).__name__} {' '.join(words)}>"

    def _path(self, *rest: str) -> str:
        return path(self.collection, self.id, *rest)
