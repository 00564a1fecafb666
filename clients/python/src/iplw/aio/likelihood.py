"""A likelihood on the server, for use with any sampler."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import requests, likelihood
from .resource import AsyncResource


class AsyncLikelihood(AsyncResource):
    """Log density of measured trials at given parameters: the target density of `posterior`, for any sampler.

    A point has one coordinate for each of `names`. `log_prob` accepts many points, (n, d); this is much faster than one request
    for each, and the server computes them in parallel, so no process pool is needed:

        likelihood = client.likelihood(scene, trials, effects=["linear_drag"])
        sampler = emcee.EnsembleSampler(64, len(likelihood.names), likelihood.log_prob, vectorize=True)
        sampler.run_mcmc(likelihood.start(64, seed=1), 1500)

    A point's value is bit-identical alone and in a batch. Variance components, and the dependence of segments on their unknown
    initial states, are fixed at the fit; model discrepancy common to all trials is integrated out (`docs/explanation/posterior.md`).
    """

    _get_operation = "get_job"

    @property
    def parameters(self) -> list[dict[str, Any]]:
        """Coordinates of a point, in order: `name`, `unit`, `prior` (its `type`, `low`, `high`, ...), and `fit`, the fitted value."""
        return list(self.data["result"]["parameters"])

    @property
    def names(self) -> list[str]:
        """Names of the coordinates: `friction`, `linear_drag.c`, ..., the same as the columns of posterior draws."""
        return [str(parameter["name"]) for parameter in self.parameters]

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(d, 2) bounds of the prior."""
        return np.array([[p["prior"]["low"], p["prior"]["high"]] for p in self.parameters], dtype=np.float64)

    async def log_prob(self, points: ArrayLike) -> NDArray[np.float64]:
        """(n,) log prior plus log likelihood of points (n, d), minus infinity where it is zero; a scalar for a single point (d,)."""
        densities = await self._evaluate(points, prior_only=False)
        return likelihood.scalar_if_single(densities[..., 0] + densities[..., 1])

    async def log_likelihood(self, points: ArrayLike) -> NDArray[np.float64]:
        """As `log_prob`, for the likelihood; minus infinity outside the support of the prior, too."""
        densities = await self._evaluate(points, prior_only=False)
        return likelihood.scalar_if_single(densities[..., 1])

    async def log_prior(self, points: ArrayLike) -> NDArray[np.float64]:
        """As `log_prob`, for the prior density; nothing is simulated."""
        densities = await self._evaluate(points, prior_only=True)
        return likelihood.scalar_if_single(densities[..., 0])

    async def start(self, n: int, seed: int | None = None) -> NDArray[np.float64]:
        """(n, d) initial points for walkers or chains near the fit, all with positive density; n from 1 to 4096."""
        return await self._connection.do(likelihood.start_points_request(self.id, self.names, n, seed))

    async def delete(self) -> None:
        """Deletes the likelihood."""
        await self._connection.do(requests.get("delete_job", self.id))

    async def _evaluate(self, points: ArrayLike, prior_only: bool) -> NDArray[np.float64]:
        """Log prior and log likelihood, (n, 2) or (2,)."""
        array = likelihood.as_points(points, self.names)
        rows = np.atleast_2d(array)
        finite = np.isfinite(rows).all(axis=1)
        densities = np.full((len(rows), 2), -np.inf)
        parts = []
        for request in likelihood.evaluation_requests(self.id, self.names, rows[finite], prior_only):
            part = await self._connection.do(request)
            parts.append(part)
        if parts:
            densities[finite] = np.concatenate(parts)
        return densities if array.ndim == 2 else densities[0]
