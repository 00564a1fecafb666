"""A surface on the server: performance of a family as a function of latent factors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .. import requests
from .resource import AsyncResource


class AsyncSurface(AsyncResource):
    """A surface."""

    _get_operation = "get_surface"

    @property
    def task(self) -> str:
        """Name of the task family."""
        return str(self.data["task"])

    @property
    def sensitivities(self) -> list[dict[str, Any]]:
        """One row for each factor: the slope of performance (AUCCESS) over the range that the prior supports."""
        return list(self.data["sensitivities"])

    async def points(self) -> dict[str, Any]:
        """The surface with its points: an `iplw.surface/1` document, as written by `iplw surface`."""
        if "surface" not in self.data:
            await self.refresh()
        return dict(self.data["surface"])

    async def draw(self, file: str | Path | None = None) -> bytes:
        """A heat map as SVG; also written to `file`, if given."""
        drawn = await self._connection.do(requests.draw(self.id))
        if file is not None:
            Path(file).write_bytes(drawn)
        return drawn

    async def delete(self) -> None:
        """Deletes the surface from the server."""
        await self._connection.do(requests.get("delete_surface", self.id))
