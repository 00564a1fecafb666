"""Likelihoods for samplers of one's own: points in arrays, walkers, and agreement with the server's own draws."""

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
    """Throws that the air holds back, seen with 1 mm of noise: t, x, y."""
    noise = np.random.default_rng(5)
    t = np.linspace(0.0, 0.9, 24)
    gone = (1 - np.exp(-DRAG * t)) / DRAG

    def throw(vx: float, vy: float) -> NDArray[np.float64]:
        x, y = vx * gone, (vy + 9.81 / DRAG) * gone - 9.81 * t / DRAG
        return np.stack([t, x, y], axis=1) + noise.normal(0, 1e-3, (24, 3)) * [0, 1, 1]

    return [throw(3 + 0.5 * k, 4 - 0.3 * k) for k in range(count)]


ASKED: dict[str, Any] = {"ball": {"radius": 0.02}, "trials": throws(), "effects": ["linear_drag", "wind"], "seed": 1}


@pytest.fixture(scope="module")
def likelihood(client: iplw.Client) -> iplw.Likelihood:
    return client.likelihood(**ASKED)


def test_points_are_asked_in_arrays(likelihood: iplw.Likelihood) -> None:
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
    # More than go into one request.
    many = np.repeat(points, 20, axis=0)
    np.testing.assert_array_equal(likelihood.log_prob(many), np.repeat(together, 20))


def test_what_is_impossible_is_infinitely_unlikely(likelihood: iplw.Likelihood) -> None:
    inside = likelihood.start(1, seed=1)[0]
    points = np.tile(inside, (5, 1))
    points[1, 0] = -0.1
    points[2, 1] = np.nan
    points[3, 2] = np.inf
    points[4, 0] = likelihood.bounds[0, 1] * 2
    for found in (likelihood.log_prob(points), likelihood.log_prior(points), likelihood.log_likelihood(points)):
        assert np.isfinite(found[0]) and (found[1:] == -np.inf).all()
    assert likelihood.log_prob(points[2]) == -np.inf
    assert likelihood.log_prob(np.empty((0, 3))).shape == (0,)
    for shape in [(3, 2), (4,), (2, 2, 3), ()]:
        with pytest.raises(ValueError, match=r"points has shape .*allowed: \(n, 3\) or \(3,\), of linear_drag.c, wind.ax"):
            likelihood.log_prob(np.ones(shape))


def test_priors_are_densities_as_told(likelihood: iplw.Likelihood) -> None:
    points = likelihood.start(5, seed=2)
    told = np.zeros(5)
    for k, parameter in enumerate(likelihood.parameters):
        prior = parameter["prior"]
        assert prior["type"] == "normal"
        grid = np.linspace(prior["low"], prior["high"], 2_000_001)
        density = np.exp(-0.5 * ((grid - prior["mean"]) / prior["sd"]) ** 2)
        whole = np.trapezoid(density, grid)
        told += -0.5 * ((points[:, k] - prior["mean"]) / prior["sd"]) ** 2 - np.log(whole)
    np.testing.assert_allclose(likelihood.log_prior(points), told, atol=1e-3)


def walked(likelihood: iplw.Likelihood, walkers: int, steps: int) -> NDArray[np.float64]:
    """Metropolis chains side by side, in a few lines: (steps, walkers, d)."""
    rng = np.random.default_rng(7)
    at = likelihood.start(walkers, seed=7)
    log_prob = likelihood.log_prob(at)
    chain: list[NDArray[np.float64]] = []
    for step in range(steps):
        # The first half learns how far to go.
        if step < steps // 2:
            root = np.linalg.cholesky(np.cov(np.concatenate(chain[step // 2 :] or [at]).T)) * 2.38 / np.sqrt(at.shape[1])
        proposed = at + rng.standard_normal(at.shape) @ root.T
        there = likelihood.log_prob(proposed)
        taken = np.log(rng.random(walkers)) < there - log_prob
        at, log_prob = np.where(taken[:, None], proposed, at), np.where(taken, there, log_prob)
        chain.append(at)
    return np.array(chain[steps // 2 :])


def test_a_sampler_of_ones_own_finds_the_same(client: iplw.Client, likelihood: iplw.Likelihood) -> None:
    asked = {**ASKED, "sets": [ASKED["effects"]]}
    del asked["effects"]
    known = client.posterior(**asked, draws=2048).wait()
    ours = np.array([known["columns"][name] for name in likelihood.names]).T
    np.testing.assert_array_equal(likelihood.log_likelihood(ours), known["log_likelihood"])
    theirs = walked(likelihood, walkers=64, steps=400).reshape(-1, 3)
    off = (theirs.mean(axis=0) - ours.mean(axis=0)) / ours.std(axis=0)
    assert (np.abs(off) < 0.15).all(), off
    ratio = theirs.std(axis=0) / ours.std(axis=0)
    assert (np.abs(ratio - 1) < 0.1).all(), ratio
    spread = np.array([[p["runs"] for p in known["parameters"]]])
    assert spread.shape == (1, 3, 4)


def test_emcee_finds_the_same(likelihood: iplw.Likelihood) -> None:
    np.random.seed(3)
    sampler = emcee.EnsembleSampler(48, 3, likelihood.log_prob, vectorize=True)
    state = sampler.run_mcmc(likelihood.start(48, seed=3), 150)
    sampler.reset()
    sampler.run_mcmc(state, 500)
    theirs, ours = sampler.get_chain(flat=True), walked(likelihood, walkers=64, steps=400).reshape(-1, 3)
    off = (theirs.mean(axis=0) - ours.mean(axis=0)) / ours.std(axis=0)
    assert (np.abs(off) < 0.2).all(), off


@pytest.mark.parametrize("url", [None, "tcp://private"], ids=["http", "zmq"])
def test_the_same_awaited(url: str | None, likelihood: iplw.Likelihood) -> None:
    points = likelihood.start(6, seed=9)
    points[2, 0] = -1.0

    async def body() -> None:
        async with iplw.AsyncClient(url) as client:
            own = await client.likelihood(**ASKED)
            assert own.names == likelihood.names
            np.testing.assert_array_equal(await own.log_prob(points), likelihood.log_prob(points))
            np.testing.assert_array_equal(await own.log_prior(points), likelihood.log_prior(points))
            np.testing.assert_array_equal(await own.start(4, seed=1), likelihood.start(4, seed=1))
            await own.delete()
            with pytest.raises(iplw.Problem) as caught:
                await own.log_prob(points)
            assert caught.value.status == 404

    asyncio.run(body())


def test_without_msgpack_it_is_the_same(likelihood: iplw.Likelihood, monkeypatch: pytest.MonkeyPatch) -> None:
    points = likelihood.start(6, seed=9)
    points[2, 0] = -1.0
    packed = likelihood.log_prob(points)
    monkeypatch.setattr("iplw.codec.msgpack", None)
    np.testing.assert_array_equal(likelihood.log_prob(points), packed)


@pytest.mark.parametrize(
    ("more", "status", "words"),
    [
        ({"effects": ["ether"]}, 404, ["ether"]),
        ({"effects": ["wind", "wind"]}, 422, ["effects", "twice"]),
        ({"prior": {"friction": [1, 0]}}, 422, ["prior"]),
        ({"job": "nowhere", "ball": None, "trials": None}, 404, ["nowhere"]),
    ],
)
def test_refusals_say_what_is_wrong(client: iplw.Client, more: dict[str, Any], status: int, words: list[str]) -> None:
    with pytest.raises(iplw.Problem) as caught:
        client.likelihood(**{**ASKED, **more})
    assert caught.value.status == status
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_trials_that_tell_nothing_are_refused_while_it_is_prepared(client: iplw.Client) -> None:
    with pytest.raises(iplw.JobFailed, match="`trials` is 0 of 1 trials"):
        client.likelihood(**{**ASKED, "trials": "t,x,y\n0,0,0\n"})


def test_too_many_or_too_few_starts(likelihood: iplw.Likelihood) -> None:
    for count in (0, 4097):
        with pytest.raises(iplw.Problem, match="count"):
            likelihood.start(count)


def test_a_handle_says_what_it_is(likelihood: iplw.Likelihood) -> None:
    assert "likelihood" in repr(likelihood) and likelihood.id in repr(likelihood)
    assert json.loads(json.dumps(likelihood.parameters))[0]["unit"] == "1/s"
