"""Likelihoods for external samplers: arrays of points, walkers, agreement with the server's posterior."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import emcee
import numpy as np
import pytest
from numpy.typing import NDArray

import iplw

#: 1/s
DRAG = 0.3


def throws(count: int = 8) -> list[NDArray[np.float64]]:
    """Throws with linear drag and 1 mm noise: t, x, y."""
    noise = np.random.default_rng(5)
    t = np.linspace(0.0, 0.9, 24)
    has_ended = (1 - np.exp(-DRAG * t)) / DRAG

    def throw(vx: float, vy: float) -> NDArray[np.float64]:
        x, y = vx * has_ended, (vy + 9.81 / DRAG) * has_ended - 9.81 * t / DRAG
        return np.stack([t, x, y], axis=1) + noise.normal(0, 1e-3, (24, 3)) * [0, 1, 1]

    return [throw(3 + 0.5 * k, 4 - 0.3 * k) for k in range(count)]


ASKED: dict[str, Any] = {"ball": {"radius": 0.02}, "trials": throws(), "effects": ["linear_drag", "wind"], "seed": 1}


@pytest.fixture(scope="module")
def likelihood(client: iplw.Client) -> iplw.Likelihood:
    return client.likelihood(**ASKED)


def test_evaluates_arrays_of_points(likelihood: iplw.Likelihood) -> None:
    assert likelihood.names == ["linear_drag.c", "wind.ax", "wind.ay"]
    points = likelihood.start(40, seed=3)
    assert points.shape == (40, 3) and points.dtype == np.float64
    np.testing.assert_array_equal(points, likelihood.start(40, seed=3))
    assert (points != likelihood.start(40, seed=4)).any()
    low, high = likelihood.bounds.T
    assert ((low <= points) & (points <= high)).all()
    together = likelihood.log_prob(points)
    assert together.shape == (40,) and np.isfinite(together).all()
    alone = [likelihood.log_prob(point) for point in points[:10]]
    assert all(isinstance(value, float) for value in alone)
    np.testing.assert_array_equal(together[:10], alone)
    np.testing.assert_array_equal(together, likelihood.log_prior(points) + likelihood.log_likelihood(points))
    # More points than fit into one request.
    many = np.repeat(points, 20, axis=0)
    np.testing.assert_array_equal(likelihood.log_prob(many), np.repeat(together, 20))


def test_zero_density_is_minus_infinity(likelihood: iplw.Likelihood) -> None:
    inside = likelihood.start(1, seed=1)[0]
    points = np.tile(inside, (5, 1))
    points[1, 0] = -0.1
    points[2, 1] = np.nan
    points[3, 2] = np.inf
    points[4, 0] = likelihood.bounds[0, 1] * 2
    for result in (likelihood.log_prob(points), likelihood.log_prior(points), likelihood.log_likelihood(points)):
        assert np.isfinite(result[0]) and (result[1:] == -np.inf).all()
    assert likelihood.log_prob(points[2]) == -np.inf
    assert likelihood.log_prob(np.empty((0, 3))).shape == (0,)
    for shape in [(3, 2), (4,), (2, 2, 3), ()]:
        with pytest.raises(ValueError, match=r"points has shape .*allowed: \(n, 3\) or \(3,\), of linear_drag.c, wind.ax"):
            likelihood.log_prob(np.ones(shape))


def test_prior_densities(likelihood: iplw.Likelihood) -> None:
    points = likelihood.start(5, seed=2)
    response = np.zeros(5)
    for k, parameter in enumerate(likelihood.parameters):
        prior = parameter["prior"]
        assert prior["type"] == "normal"
        grid = np.linspace(prior["low"], prior["high"], 2_000_001)
        density = np.exp(-0.5 * ((grid - prior["mean"]) / prior["sd"]) ** 2)
        complete = np.trapezoid(density, grid)
        response += -0.5 * ((points[:, k] - prior["mean"]) / prior["sd"]) ** 2 - np.log(complete)
    np.testing.assert_allclose(likelihood.log_prior(points), response, atol=1e-3)


def sampled_chains(likelihood: iplw.Likelihood, walkers: int, steps: int) -> NDArray[np.float64]:
    """Parallel Metropolis chains: (steps, walkers, d)."""
    rng = np.random.default_rng(7)
    at = likelihood.start(walkers, seed=7)
    log_prob = likelihood.log_prob(at)
    chain: list[NDArray[np.float64]] = []
    for step in range(steps):
        # The first half adapts the proposal scale.
        if step < steps // 2:
            root = np.linalg.cholesky(np.cov(np.concatenate(chain[step // 2 :] or [at]).T)) * 2.38 / np.sqrt(at.shape[1])
        proposed = at + rng.standard_normal(at.shape) @ root.T
        remote = likelihood.log_prob(proposed)
        collected = np.log(rng.random(walkers)) < remote - log_prob
        at, log_prob = np.where(collected[:, None], proposed, at), np.where(collected, remote, log_prob)
        chain.append(at)
    return np.array(chain[steps // 2 :])


def test_metropolis_matches_posterior(client: iplw.Client, likelihood: iplw.Likelihood) -> None:
    requested = {**ASKED, "sets": [ASKED["effects"]]}
    del requested["effects"]
    identified = client.posterior(**requested, draws=2048).wait()
    ours = np.array([identified["columns"][name] for name in likelihood.names]).T
    np.testing.assert_array_equal(likelihood.log_likelihood(ours), identified["log_likelihood"])
    theirs = sampled_chains(likelihood, walkers=64, steps=400).reshape(-1, 3)
    off = (theirs.mean(axis=0) - ours.mean(axis=0)) / ours.std(axis=0)
    assert (np.abs(off) < 0.15).all(), off
    ratio = theirs.std(axis=0) / ours.std(axis=0)
    assert (np.abs(ratio - 1) < 0.1).all(), ratio
    spread = np.array([[p["runs"] for p in identified["parameters"]]])
    assert spread.shape == (1, 3, 4)


def test_emcee_matches_metropolis(likelihood: iplw.Likelihood) -> None:
    np.random.seed(3)
    sampler = emcee.EnsembleSampler(48, 3, likelihood.log_prob, vectorize=True)
    state = sampler.run_mcmc(likelihood.start(48, seed=3), 150)
    sampler.reset()
    sampler.run_mcmc(state, 500)
    theirs, ours = sampler.get_chain(flat=True), sampled_chains(likelihood, walkers=64, steps=400).reshape(-1, 3)
    off = (theirs.mean(axis=0) - ours.mean(axis=0)) / ours.std(axis=0)
    assert (np.abs(off) < 0.2).all(), off


@pytest.mark.parametrize("url", [None, "tcp://private"], ids=["http", "zmq"])
def test_async_likelihood(url: str | None, likelihood: iplw.Likelihood) -> None:
    points = likelihood.start(6, seed=9)
    points[2, 0] = -1.0

    async def body() -> None:
        async with iplw.AsyncClient(url) as client:
            separate = await client.likelihood(**ASKED)
            assert separate.names == likelihood.names
            np.testing.assert_array_equal(await separate.log_prob(points), likelihood.log_prob(points))
            np.testing.assert_array_equal(await separate.log_prior(points), likelihood.log_prior(points))
            np.testing.assert_array_equal(await separate.start(4, seed=1), likelihood.start(4, seed=1))
            await separate.delete()
            with pytest.raises(iplw.Problem) as caught:
                await separate.log_prob(points)
            assert caught.value.status == 404

    asyncio.run(body())


def test_json_matches_msgpack(likelihood: iplw.Likelihood, monkeypatch: pytest.MonkeyPatch) -> None:
    points = likelihood.start(6, seed=9)
    points[2, 0] = -1.0
    packed = likelihood.log_prob(points)
    monkeypatch.setattr("iplw.codec.msgpack", None)
    np.testing.assert_array_equal(likelihood.log_prob(points), packed)


@pytest.mark.parametrize(
    ("extra", "status", "words"),
    [
        ({"effects": ["ether"]}, 404, ["ether"]),
        ({"effects": ["wind", "wind"]}, 422, ["effects", "twice"]),
        ({"prior": {"friction": [1, 0]}}, 422, ["prior"]),
        ({"job": "nowhere", "ball": None, "trials": None}, 404, ["nowhere"]),
    ],
)
def test_problems_name_the_invalid_value(client: iplw.Client, extra: dict[str, Any], status: int, words: list[str]) -> None:
    with pytest.raises(iplw.Problem) as caught:
        client.likelihood(**{**ASKED, **extra})
    assert caught.value.status == status
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_rejects_insufficient_trials(client: iplw.Client) -> None:
    with pytest.raises(iplw.JobFailed, match="`trials` is 0 of 1 trials"):
        client.likelihood(**{**ASKED, "trials": "t,x,y\n0,0,0\n"})


def test_rejects_invalid_start_count(likelihood: iplw.Likelihood) -> None:
    for count in (0, 4097):
        with pytest.raises(iplw.Problem, match="count"):
            likelihood.start(count)


def test_likelihood_repr(likelihood: iplw.Likelihood) -> None:
    assert "likelihood" in repr(likelihood) and likelihood.id in repr(likelihood)
    assert json.loads(json.dumps(likelihood.parameters))[0]["unit"] == "1/s"
