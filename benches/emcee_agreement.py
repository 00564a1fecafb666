"""Compares `iplw posterior` with an independent sampler: emcee on the same likelihood.

    iplw measure --task bowling --effect linear_drag:c=0.223 --noise 0.005 --trials 50 --seed 1 --out measured
    pip install emcee
    PYTHONPATH=clients/python/src python benches/emcee_agreement.py target/release/iplw measured --effects linear_drag

Prints means and standard deviations of both, their differences, and the cost of each; fails if means differ by more than 0.1 standard
deviations or standard deviations by more than 10 %. emcee (Foreman-Mackey et al., PASP 125 (2013) 306) uses the fit only for the
initial positions of its walkers, and runs until its own estimate of the effective sample size is sufficient.
"""

import argparse
import json
import logging
import sys
import time
from pathlib import Path

import emcee
import numpy as np

import iplw

#: Tolerances of means, in standard deviations, and of standard deviations, relative.
MEANS, DEVIATIONS = 0.1, 0.1
#: Steps between two convergence checks, and the maximum number of steps.
STEPS, MOST = 250, 20_000


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("binary")
    parser.add_argument("measured", type=Path, help="directory of `iplw measure`: scene.json and trials.csv")
    parser.add_argument("--effects", nargs="*", default=[])
    parser.add_argument("--calibrate", nargs="*", help="latents to calibrate (default: those of the scene)")
    parser.add_argument("--walkers", type=int, default=64)
    parser.add_argument("--effective", type=float, default=1500)
    parser.add_argument("--draws", type=int, default=4096, help="number of draws of the built-in sampler")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    # Chain length is checked here.
    logging.getLogger("emcee").setLevel(logging.ERROR)
    with iplw.Client(binary=asked.binary) as client:
        sys.exit(compare(client, asked))


def compare(client, asked):
    scene = json.loads((asked.measured / "scene.json").read_text())
    more = {"calibrate": asked.calibrate, "seed": asked.seed}
    begun = time.perf_counter()
    likelihood = client.likelihood(scene, asked.measured / "trials.csv", effects=asked.effects, **more)
    print(f"prepared in {time.perf_counter() - begun:.1f} s: {likelihood.data['result']['windows']} windows a likelihood")
    begun = time.perf_counter()
    job = client.posterior(scene, asked.measured / "trials.csv", sets=[asked.effects], draws=asked.draws, **more)
    known = job.wait(timeout=3600)
    spent = time.perf_counter() - begun
    names = likelihood.names
    ours = np.array([known["columns"][name] for name in names]).T
    same = likelihood.log_likelihood(ours) == np.array(known["log_likelihood"])
    print(f"log likelihoods of {len(ours)} draws asked again: {same.sum()} the same to the bit")
    quality = known["sets"][0]["quality"]
    print(f"built-in: {known['sets'][0]['evaluations']} likelihoods, {spent:.1f} s with the fit; "
          f"R-hat at most {max(quality['r_hat']):.4f}")
    theirs, effective = drawn(likelihood, asked)
    return table(names, ours, theirs, quality["effective"], effective, np.array(known["run"])) or int(not same.all())


def drawn(likelihood, asked):
    """emcee's draws, and the effective sample size of each parameter."""
    np.random.seed(asked.seed)
    sampler = emcee.EnsembleSampler(asked.walkers, len(likelihood.names), likelihood.log_prob, vectorize=True)
    state, begun = likelihood.start(asked.walkers, seed=asked.seed), time.perf_counter()
    while True:
        state = sampler.run_mcmc(state, STEPS)
        steps = sampler.iteration
        correlated = sampler.get_autocorr_time(quiet=True, discard=steps // 4, has_walkers=True)
        effective = asked.walkers * (steps - steps // 4) / correlated
        # emcee's recommendation: a chain of 50 autocorrelation times, without the burn-in.
        if effective.min() >= asked.effective and steps - steps // 4 >= 50 * correlated.max():
            break
        if steps >= MOST:
            sys.exit(f"emcee's effective sample size is {effective.round()} after {steps} steps")
    print(f"emcee {emcee.__version__}: {asked.walkers} walkers, {steps} steps, {asked.walkers * (steps + 1)} likelihoods, "
          f"{time.perf_counter() - begun:.1f} s; {np.mean(sampler.acceptance_fraction):.2f} accepted, "
          f"remembers {correlated.max():.0f} steps")
    return sampler.get_chain(discard=steps // 4, flat=True), effective


def table(names, ours, theirs, worth, effective, run):
    """Prints both posteriors; returns 1 if they differ."""
    print("\n| | built-in, mean +- sd | emcee, mean +- sd | means differ by, sd | ratio of sds | spread of runs' means, sd "
          "| effective draws, built-in and emcee |\n|---|---|---|---|---|---|---|")
    failed = 0
    for k, name in enumerate(names):
        (a, b), (sa, sb) = [c[:, k].mean() for c in (ours, theirs)], [c[:, k].std(ddof=1) for c in (ours, theirs)]
        runs = np.std([ours[run == r, k].mean() for r in range(run.max() + 1)], ddof=1) / sa
        digits = max(0, 2 - int(np.floor(np.log10(sa))))
        off, ratio = (a - b) / sb, sa / sb
        failed |= abs(off) > MEANS or abs(ratio - 1) > DEVIATIONS
        print(f"| {name} | {a:.{digits}f} +- {sa:.{digits}f} | {b:.{digits}f} +- {sb:.{digits}f} | {off:+.3f} | {ratio:.3f} "
              f"| {runs:.3f} | {worth[k]:.0f}, {effective[k]:.0f} |")
    print(f"\n{'NOT ' if failed else ''}the same: means within {MEANS} sd and sds within {DEVIATIONS:.0%}")
    return int(failed)


if __name__ == "__main__":
    main()
