# Made by `generate.py` from `aio/surface.py`; change that.
"""A surface on the server: how a family's performance depends on latent factors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .. import calls
from .handle import Handle


class Surface(Handle):
    """A handle on one surface."""

    _look = "get_surface"

    @property
    def task(self) -> str:
        """The family it is about."""
        return str(self.data["task"])

    @property
    def sensitivities(self) -> list[dict[str, Any]]:
        """A row a factor: the slope of performance (AUCCESS) over what the prior holds likely."""
        return list(self.data["sensitivities"])

    def points(self) -> dict[str, Any]:
        """The surface with its points, `iplw.surface/1`, as `iplw surface` writes it."""
        if "surface" not in self.data:
            self.refresh()
        return dict(self.data["surface"])

    def draw(self, file: str | Path | None = None) -> bytes:
        """A heat map as SVG; also written to `file`, if given."""
        drawn = self._line.do(calls.draw(self.id))
        if file is not None:
            Path(file).write_bytes(drawn)
        return drawn

    def delete(self) -> None:
        """Removes the surface from the server."""
        self._line.do(calls.get("delete_surface", self.id))
