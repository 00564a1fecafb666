"""PySINDy on free flights: sparse regression of accelerations on the laws (Brunton, Proctor and Kutz, PNAS 113 (2016) 3932).

Velocities and accelerations come from `SmoothedFiniteDifference`. Each law is one candidate feature: the two axes of a trial are two
trajectories of one velocity component each, so that a drag has the same coefficient along both. Laws with parameters inside (gust, sticky
patch, moving air) offer their features at one point of a grid at a time. Features and accelerations have unit root mean square. Two
optimizers make models of all degrees of sparsity: `STLSQ` by its threshold, and `SSR`, which drops one term at a time by the residual and so
bears laws that resemble each other. Chosen is the model with the fewest parameters (those inside a law included) whose error on held-out
trials, its terms refitted to the others, is within two standard errors of the lowest (paired over trials). A drag that accelerates is no law;
where no model without one is as good, the verdict is unknown.

Active features become names: `w` linear_drag, `speed w` quadratic_drag, `across` lift, `at x` or `at y` position_field (a constant beside
it is the field's centre), `constant x` wind (with or without `constant y`), `constant y` alone gravity_error, those of the grid their law.
"""

import warnings

import numpy as np
import pysindy
from pysindy.differentiation import SmoothedFiniteDifference
from scipy.interpolate import CubicSpline

import flight_fits

#: Points of the smoothing window and its degree; points left out at both ends of a trial, where derivatives are poor.
WINDOW, DEGREE, ENDS = 15, 3, 4
#: Thresholds, in shares of the accelerations' root mean square, and folds of the cross-validation.
THRESHOLDS, FOLDS = np.geomspace(0.03, 0.8, 8), 5
#: Standard errors within which held-out errors are equal.
STANDARD_ERRORS = 2.0
#: Weight of the ridge in both optimizers, and most terms of a model by `SSR`.
RIDGE, MOST_TERMS = 1e-6, 6
FEATURES = ["w", "speed w", "across", "constant x", "constant y", "at x", "at y"]
#: Laws with parameters inside, and how many each has.
SHAPED, SHAPE_PARAMETERS = ("moving_air", "gust", "sticky_patch"), 2


def derivatives(times, positions):
    """Positions, velocities and accelerations of a trial on an even grid, without its ends."""
    smooth = SmoothedFiniteDifference(smoother_kws={"window_length": WINDOW, "polyorder": DEGREE})
    velocity = np.asarray(smooth._differentiate(positions, times))
    path = np.asarray(smooth.smoothed_x_)
    acceleration = np.asarray(smooth._differentiate(velocity, times))
    velocity = np.asarray(smooth.smoothed_x_)
    kept = slice(ENDS, len(times) - ENDS)
    return times[kept], path[kept], velocity[kept], acceleration[kept]


def even(flights, i):
    """Times and positions of a trial on an even grid; missing points and outliers are interpolated."""
    seen = flights.weights[i] > 0.0
    times = flights.times[i][seen]
    gap = np.median(np.diff(times))
    grid = times[0] + gap * np.arange(int(round((times[-1] - times[0]) / gap)) + 1)
    grid[-1] = min(grid[-1], times[-1])
    return grid, CubicSpline(times, flights.positions[i][seen])(grid)


def tables(flights):
    """For each trial: features (2 points, features), shaped features by law, and accelerations beyond gravity (2 points)."""
    known = flight_fits.laws(flights)
    out = []
    for i in range(len(flights.times)):
        t, at, v, a = derivatives(*even(flights, i))
        speed, zero, one = np.hypot(*v.T), np.zeros(len(t)), np.ones(len(t))
        stack = lambda x, y: np.concatenate([x, y])
        plain = [stack(*v.T), stack(*(speed[:, None] * v).T), stack(-v[:, 1], v[:, 0]), stack(one, zero), stack(zero, one),
                 stack(at[:, 0], zero), stack(zero, at[:, 1])]
        shaped = {name: shaped_features(known[name], t, np.concatenate([at, v], axis=1).T, flights.gravity) for name in SHAPED}
        out.append((np.array(plain).T, shaped, stack(*(a - flights.gravity).T)))
    return out


def shaped_features(law, t, state, gravity):
    """Features of each grid point of a law: (points, 2 times, amplitudes). Axes of a gust have an amplitude each."""
    out = []
    for shape in law.shapes:
        columns = []
        for k in range(law.amplitudes):
            p = [*np.eye(law.amplitudes)[k], *shape]
            columns.append(np.concatenate([np.broadcast_to(a, t.shape) for a in law.acceleration(t, state, gravity, p)]))
        out.append(np.array(columns).T)
    return np.array(out)


def fitted(features, target):
    """Coefficients (models, features) of models of scaled features and accelerations, in a fixed order of sparsity."""

    def fit(optimizer):
        model = pysindy.SINDy(optimizer=optimizer, feature_library=pysindy.IdentityLibrary())
        with warnings.catch_warnings():
            # A model without any term is an answer here.
            warnings.simplefilter("ignore")
            model.fit(features[:, :1], t=1.0, x_dot=target[:, None], u=features[:, 1:])
        return model

    stepwise = fit(pysindy.SSR(criteria="model_residual", alpha=RIDGE)).optimizer.history_
    thresholded = [fit(pysindy.STLSQ(threshold=threshold, alpha=RIDGE)).coefficients()[0] for threshold in THRESHOLDS]
    return np.array([np.zeros(features.shape[1]), *(one[0] for one in stepwise[:-MOST_TERMS - 1:-1]), *thresholded])


def variants(trials):
    """Feature tables of all trials: the plain laws, and with each law of `SHAPED` at its most promising grid point."""
    plain, targets = [one[0] for one in trials], [one[2] for one in trials]
    out = [(None, plain)]
    everything, target = np.concatenate(plain), np.concatenate(targets)
    left = target - everything @ np.linalg.lstsq(everything, target, rcond=None)[0]
    for name in SHAPED:
        gained = []
        for i in range(trials[0][1][name].shape[0]):
            columns = np.concatenate([one[1][name][i] for one in trials])
            free = columns - everything @ np.linalg.lstsq(everything, columns, rcond=None)[0]
            gained.append((left ** 2).sum() - ((left - free @ np.linalg.lstsq(free, left, rcond=None)[0]) ** 2).sum())
            alone = target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]
            gained[-1] = (gained[-1], -(alone ** 2).sum())
        for key in (0, 1):
            i = max(range(len(gained)), key=lambda i: gained[i][key])
            out.append((name, [np.concatenate([one[0], one[1][name][i]], axis=1) for one in trials]))
    return out, targets


def diagnose(flights):
    """Verdict, and the named set of laws."""
    trials = tables(flights)
    offered, targets = variants(trials)
    scale = np.sqrt(np.mean(np.concatenate(targets) ** 2))
    targets = [target / scale for target in targets]
    found = []
    for name, features in offered:
        size = np.sqrt(np.mean(np.concatenate(features) ** 2, axis=0)) + 1e-12
        features = [one / size for one in features]
        models = {tuple(model != 0.0): model for model in fitted(np.concatenate(features), np.concatenate(targets))}
        found += [(held_out([one[:, active] for one in features], targets), model, name) for active, model in models.items()]
    chosen = sparsest(found)
    return ("Unknown", []) if chosen is None else named(*chosen)


def held_out(features, targets):
    """Mean square error of each trial, by the terms fitted to the trials of the other folds."""
    fold = np.arange(len(targets)) % FOLDS
    errors = np.empty(len(targets))
    for k in range(FOLDS):
        train = np.flatnonzero(fold != k)
        sizes = np.linalg.lstsq(np.concatenate([features[i] for i in train]), np.concatenate([targets[i] for i in train]), rcond=None)[0]
        for i in np.flatnonzero(fold == k):
            errors[i] = np.mean((targets[i] - features[i] @ sizes) ** 2)
    return errors


def sparsest(found):
    """The lawful model with the fewest parameters whose held-out error is within two standard errors of the lowest; None without one."""
    lowest = min(found, key=lambda one: one[0].mean())[0]

    def allowed(errors, coefficients, law):
        worse = errors - lowest
        return is_lawful(coefficients, law) and worse.mean() <= STANDARD_ERRORS * worse.std(ddof=1) / np.sqrt(len(worse))

    def parameters(coefficients):
        return np.count_nonzero(coefficients) + SHAPE_PARAMETERS * bool(np.any(coefficients[len(FEATURES):]))

    good = [one for one in found if allowed(*one)]
    return min(good, key=lambda one: (parameters(one[1]), one[0].mean()))[1:] if good else None


def is_lawful(coefficients, law):
    """Whether no drag accelerates."""
    value = dict(zip(FEATURES, coefficients))
    accelerates = law in ("moving_air", "sticky_patch") and np.any(coefficients[len(FEATURES):] < 0.0)
    return not (accelerates or value["w"] > 0.0 or value["speed w"] > 0.0)


def named(coefficients, law):
    """Verdict, and the names of the laws of the active terms."""
    active = {name for name, c in zip(FEATURES, coefficients) if c != 0.0}
    names = set()
    if np.any(coefficients[len(FEATURES):] != 0.0):
        names.add(law)
    if {"at x", "at y"} & active:
        names.add("position_field")
    elif "constant x" in active:
        names.add("wind")
    elif "constant y" in active:
        names.add("gravity_error")
    names |= {name for name, term in (("linear_drag", "w"), ("quadratic_drag", "speed w"), ("lift", "across")) if term in active}
    return "Named" if names else "None", sorted(names)
