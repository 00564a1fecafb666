"""ArviZ's trace, pair and posterior plots of a posterior of `Client.posterior`: a ball thrown through air.

The throws are simulated here with a drag of 0.3 1/s and a wind of 0.5 m/s^2, and 1 mm of noise. Prints ArviZ's summary.

    pip install iplw 'arviz<1' && python examples/python/plot_arviz.py
"""

from __future__ import annotations

import argparse
from pathlib import Path

import arviz as az
import numpy as np
from numpy.typing import NDArray

import iplw

TRUTH = {"linear_drag.c": 0.3, "wind.ax": 0.5, "wind.ay": 0.0}
GRAVITY = 9.81


def throw(vx: float, vy: float, camera: np.random.Generator) -> NDArray[np.float64]:
    """(24, 3) t, s, and noisy x and y, m: dv/dt = a - c v."""
    c, t = TRUTH["linear_drag.c"], np.linspace(0.0, 0.9, 24)
    decay = (1 - np.exp(-c * t)) / c
    speed, pull = np.array([vx, vy]), np.array([TRUTH["wind.ax"], TRUTH["wind.ay"] - GRAVITY])
    path = np.outer(decay, speed - pull / c) + np.outer(t, pull / c)
    return np.column_stack([t, path + camera.normal(0.0, 1e-3, path.shape)])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--out", default=".", help="directory of the plots")
    options = parser.parse_args()
    camera = np.random.default_rng(5)
    throws = [throw(3 + 0.5 * k, 4 - 0.3 * k, camera) for k in range(8)]
    with iplw.Client() as client:
        sets = [["linear_drag", "wind"]]
        document = client.posterior(trials=throws, ball={"radius": 0.02}, sets=sets, draws=options.draws, seed=1).wait()
    # ArviZ's chains are the independent runs, whose draws follow one another.
    shape = (len(set(document["run"])), -1)
    data = az.from_dict(posterior={name: np.reshape(column, shape) for name, column in document["columns"].items()})
    print(az.summary(data, round_to=4).assign(truth=TRUTH)[["truth", "mean", "sd", "hdi_3%", "hdi_97%", "r_hat"]])
    plots = {
        "trace": az.plot_trace(data),
        "pair": az.plot_pair(data, kind="kde", marginals=True),
        "posterior": az.plot_posterior(data, ref_val=list(TRUTH.values())),
    }
    for name, axes in plots.items():
        np.ravel(axes)[0].figure.savefig(Path(options.out) / f"{name}.png")


if __name__ == "__main__":
    main()
