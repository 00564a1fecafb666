"""sbi: neural posterior of friction and restitution from bounces, with the rank plot of simulation-based calibration (SBC).

Prints the posterior for a known truth, and the p-value of uniform ranks, which is small if intervals are wrong; writes sbc.png.

    pip install iplw sbi six && python examples/python/infer_sbi.py
"""

from __future__ import annotations

import numpy as np
import torch
from sbi.analysis import sbc_rank_plot
from sbi.diagnostics import check_sbc, run_sbc
from sbi.inference import NPE
from sbi.utils import BoxUniform

import iplw

TRUTH = {"friction": 0.35, "restitution": 0.65}
NOISE_M = 0.05
SCENE = {
    "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0.0, 1.0]}],
    "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0.0, 1.0], "offset": 0.0}}],
    "action": {"components": [{"target": "ball", "set": "vx", "low": 0.0, "high": 20.0}]},
    "goal": {"type": "above", "body": "ball", "height": 5.0},
    "format": "iplw.scene/1", "time_step": 0.002, "steps": 400, "observe_every": 50,
}


def simulate(world: iplw.World, latents: torch.Tensor) -> torch.Tensor:
    """(n, 8) noisy x and y, m, at 0.6 and 0.8 s of throws with 10 and 20 m/s, for n pairs of latents."""
    rows = []
    for pair in latents.tolist():
        throws = world.set_latents(**dict(zip(TRUTH, pair))).rollout([[0.5], [1.0]], trajectories=True, stop=False)
        rows.append(np.ravel([throw.bodies["ball"][[6, 8], :2] for throw in throws]))
    return torch.tensor(np.array(rows)).float() + NOISE_M * torch.randn(len(rows), 8)


def main() -> None:
    torch.manual_seed(0)
    torch.set_num_threads(1)  # Small networks are slower with more.
    prior = BoxUniform(torch.zeros(2), torch.tensor([1.0, 0.9]))
    draws, tests, truth = prior.sample((2000,)), prior.sample((200,)), torch.tensor([[*TRUTH.values()]])
    with iplw.Client() as client, client.create_world(scene=SCENE) as world:
        world.reset()
        data, test_data, observed = (simulate(world, latents) for latents in (draws, tests, truth))
    inference = NPE(prior, density_estimator="mdn", show_progress_bars=False).append_simulations(draws, data)
    posterior = inference.build_posterior(inference.train(learning_rate=5e-3, max_num_epochs=100))
    samples = posterior.sample((2000,), x=observed, show_progress_bars=False)
    ranks, averages = run_sbc(tests, test_data, posterior, num_posterior_samples=300, show_progress_bar=False)
    sbc = check_sbc(ranks, tests, averages, num_posterior_samples=300)
    print()  # sbi leaves its last line open.
    for name, mean, sd, p in zip(TRUTH, samples.mean(0), samples.std(0), sbc["ks_pvals"]):
        print(f"{name:12} truth {TRUTH[name]:.3f}  posterior {mean:.3f} +- {sd:.3f}  SBC p {p:.2f}")
    sbc_rank_plot(ranks, 300, parameter_labels=list(TRUTH), plot_type="hist")[0].savefig("sbc.png")


if __name__ == "__main__":
    main()
