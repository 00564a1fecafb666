"""Free flights of an exported world, cleaned alike for every method of `other_diagnoses.py`.

A point is an outlier if it is more than 5 robust standard deviations off a polynomial of its trial. The same polynomials give the variance
of the measurement noise: what is left of the points when everything smooth is taken away.
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd

#: Degree of the polynomial of a trial in time, and the distance of an outlier in robust standard deviations.
DEGREE, OUTLIER_SD = 6, 5.0
#: Fewest points of a trial, and the number of passes that remove outliers.
MIN_POINTS, PASSES = 12, 4


class Flights:
    """Trials of one ball: times and positions, padded to equal length.

    `times`, `weights`: (trials, points); `positions`: (trials, points, 2), m; weight 0 marks padding, missing points and outliers;
    `noise_variance`: of a coordinate, m^2; `gravity`: of the scene, m/s^2.
    """

    def __init__(self, times, positions, weights, noise_variance, gravity):
        self.times, self.positions, self.weights = times, positions, weights
        self.noise_variance, self.gravity = noise_variance, gravity

    def number(self):
        """Number of measured coordinates."""
        return int(2 * self.weights.sum())


def read(folder):
    """The flights of a world, and its hidden truth."""
    folder = Path(folder)
    for name in ("trials.csv", "scene.json", "truth.json"):
        if not (folder / name).is_file():
            raise SystemExit(f"{folder} has no {name}: export the worlds with `--export` of the example that makes them")
    scene = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    rows = pd.read_csv(folder / "trials.csv")
    lacking = [column for column in ("trial", "t", "x", "y") if column not in rows]
    if lacking:
        raise SystemExit(f"{folder / 'trials.csv'} has no column {', '.join(lacking)}")
    tracks = [one[["t", "x", "y"]].to_numpy(float) for _, one in rows.groupby("trial", sort=False)]
    return padded(tracks, scene["gravity"]), truth


def padded(tracks, gravity):
    """Flights of a list of tables (t, x, y), each cleaned."""
    longest = max(len(track) for track in tracks)
    times, weights = np.zeros((2, len(tracks), longest))
    positions = np.zeros((len(tracks), longest, 2))
    squares = freedom = 0.0
    for i, track in enumerate(tracks):
        count = len(track)
        seen, left = cleaned(track)
        times[i, :count], times[i, count:] = track[:, 0] - track[0, 0], track[-1, 0] - track[0, 0]
        weights[i, :count], positions[i, :count] = seen, np.where(seen[:, None], track[:, 1:], 0.0)
        squares += (left[seen] ** 2).sum()
        freedom += 2 * (seen.sum() - DEGREE - 1)
    return Flights(times, positions, weights, squares / freedom, np.array(gravity, float))


def cleaned(track):
    """Which points of a trial are no outliers, and the residuals of its polynomial."""
    span = track[-1, 0] - track[0, 0]
    basis = np.polynomial.chebyshev.chebvander(2.0 * (track[:, 0] - track[0, 0]) / span - 1.0, DEGREE)
    there = np.isfinite(track[:, 1:]).all(axis=1)
    if there.sum() < MIN_POINTS:
        raise SystemExit(f"a trial has {there.sum()} points; at least {MIN_POINTS} are needed")
    measured = np.where(there[:, None], track[:, 1:], 0.0)
    share = there.astype(float)
    for _ in range(PASSES):
        root = np.sqrt(share)[:, None]
        fit = np.linalg.lstsq(root * basis, root * measured, rcond=None)[0]
        left = measured - basis @ fit
        sd = 1.4826 * np.median(np.abs(left[there])) + 1e-12
        far = np.hypot(left[:, 0], left[:, 1]) / (np.sqrt(2.0) * sd)
        # Tukey's biweight, and in the end all or nothing.
        share = np.where(there & (far < OUTLIER_SD), (1.0 - (far / OUTLIER_SD) ** 2) ** 2, 0.0)
    seen = share > 0.0
    fit = np.linalg.lstsq(basis[seen], measured[seen], rcond=None)[0]
    return seen, measured - basis @ fit
