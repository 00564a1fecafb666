"""A likelihood on the server, for a sampler of one's own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import calls, likelihood
from .handle import AsyncHandle


class AsyncLikelihood(AsyncHandle):
    """How likely measured trials are at points of your choice: what `posterior` draws from, for any sampler.

    A point has a number for each of `names`. `log_prob` takes many points at once, (n, d), which costs far less than asking
    one by one; the server computes them in parallel, so that no pool of processes is needed:

        likelihood = client.likelihood(scene, trials, effects=["linear_drag"])
        sampler = emcee.EnsembleSampler(64, len(likelihood.names), likelihood.log_prob, vectorize=True)
        sampler.run_mcmc(likelihood.start(64, seed=1), 1500)

    A point's numbers are the same bits alone and in company. Variance components, and how stretches of trials depend on their
    unknown starts, are those at the fit; what trials share and the model lacks is integrated out (`docs/posterior.md`).
    """

    _look = "get_job"

    @property
    def parameters(self) -> list[dict[str, Any]]:
        """The numbers of a point, in order: `name`, `unit`, `prior` (its `type`, `low`, `high`, ...), and `fit`, where the fit stands."""
        return list(self.data["result"]["parameters"])

    @property
    def names(self) -> list[str]:
        """Their names: `friction`, `linear_drag.c`, ..., as columns of a posterior's draws have them."""
        return [str(parameter["name"]) for parameter in self.parameters]

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(d, 2) least and greatest values that the prior allows."""
        return np.array([[p["prior"]["low"], p["prior"]["high"]] for p in self.parameters], dtype=np.float64)

    async def log_prob(self, points: ArrayLike) -> NDArray[np.float64]:
        """(n,) log prior plus log likelihood of points (n, d), minus infinity where they are impossible; of a point (d,) a number."""
        found = await self._ask(points, prior_only=False)
        return likelihood.plain(found[..., 0] + found[..., 1])

    async def log_likelihood(self, points: ArrayLike) -> NDArray[np.float64]:
        """The same of the likelihood alone; minus infinity also where the prior does not allow a point."""
        found = await self._ask(points, prior_only=False)
        return likelihood.plain(found[..., 1])

    async def log_prior(self, points: ArrayLike) -> NDArray[np.float64]:
        """The same of the prior alone, a density; nothing is simulated for it."""
        found = await self._ask(points, prior_only=True)
        return likelihood.plain(found[..., 0])

    async def start(self, n: int, seed: int | None = None) -> NDArray[np.float64]:
        """(n, d) points about the fit for walkers or chains to begin at, none of them impossible; 1 to 4096 of them."""
        return await self._line.do(likelihood.starts(self.id, self.names, n, seed))

    async def delete(self) -> None:
        """Removes it from the server."""
        await self._line.do(calls.get("delete_job", self.id))

    async def _ask(self, points: ArrayLike, prior_only: bool) -> NDArray[np.float64]:
        """Log prior and log likelihood, (n, 2) or (2,)."""
        array = likelihood.checked(points, self.names)
        rows = np.atleast_2d(array)
        finite = np.isfinite(rows).all(axis=1)
        found = np.full((len(rows), 2), -np.inf)
        parts = []
        for call in likelihood.asked(self.id, self.names, rows[finite], prior_only):
            part = await self._line.do(call)
            parts.append(part)
        if parts:
            found[finite] = np.concatenate(parts)
        return found if array.ndim == 2 else found[0]
