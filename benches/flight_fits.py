"""The laws of free flight, each set of at most two fitted by nonlinear least squares, the lowest BIC first.

Start states of all trials are free. A step of Levenberg and Marquardt eliminates them trial by trial (variable projection: Golub and
Pereyra, SIAM J. Numer. Anal. 10 (1973) 413); derivatives are finite differences, and all perturbed paths of all trials are integrated at
once. The criterion is BIC = n ln(RSS / n) + k ln n (Schwarz, Ann. Stat. 6 (1978) 461) of n coordinates and k parameters.

A law with parameters inside (a period, an edge, the velocity of the air) starts from the points of a grid that remove most of what the set
without it leaves, to first order.
"""

import itertools

import numpy as np

#: Longest step of the integrator, s, and steps for each of them where a law has edges.
STEP, EDGE_STEPS = 0.06, 2
#: Width over which the edge of a patch is smooth, m, so that least squares can move it.
EDGE = 0.05
#: Most steps of a fit, and the relative decrease of the squares at which it ends.
ITERATIONS, DECREASE = 15, 1e-6
#: A set is not followed if this many times what it gains to first order would leave its BIC above all rivals of the lowest.
GAIN_MARGIN = 2.0
#: Starting points of the grid that are followed, for one law and for a further one.
STARTS = [3, 1]
#: Sets whose BIC differs by less are one: flights cannot distinguish them. Sets within RIVAL are not rejected.
SAME, RIVAL = 0.1, 2.0
#: A set is rejected if its residuals have more than this times the variance of the noise.
MISFIT = 2.0


class Law:
    """A law: its acceleration is linear in `amplitudes` parameters; `shapes`: starting points of the others, (points, number)."""

    def __init__(self, amplitudes, acceleration, shapes=None, edges=False):
        self.amplitudes, self.acceleration, self.edges = amplitudes, acceleration, edges
        self.shapes = np.zeros((1, 0)) if shapes is None else np.array(shapes, float)
        self.count = amplitudes + self.shapes.shape[1]


def drag(t, s, g, p):
    return -p[0] * s[2], -p[0] * s[3]


def quadratic(t, s, g, p):
    v = np.sqrt(s[2] ** 2 + s[3] ** 2)
    return -p[0] * v * s[2], -p[0] * v * s[3]


def moving_air(t, s, g, p):
    wx, wy = s[2] - p[1], s[3] - p[2]
    w = np.sqrt(wx * wx + wy * wy)
    return -p[0] * w * wx, -p[0] * w * wy


def gust(t, s, g, p):
    swing = np.sin(2.0 * np.pi * t / p[2] + p[3])
    return p[0] * swing, p[1] * swing


def patch(t, s, g, p):
    within = 0.25 * (1.0 + np.tanh((s[0] - p[1]) / (2.0 * EDGE))) * (1.0 + np.tanh((p[2] - s[0]) / (2.0 * EDGE)))
    return -p[0] * within * s[2], -p[0] * within * s[3]


def tilt(t, s, g, p):
    cos, sin = np.cos(p[0]), np.sin(p[0])
    return g[0] * (cos - 1.0) - g[1] * sin, g[1] * (cos - 1.0) + g[0] * sin


def laws(flights):
    """The laws of the library that can be hidden in a flight. A gravity error stands for its twins, scale and clock."""
    seen = flights.weights > 0.0
    left, right = flights.positions[seen][:, 0].min(), flights.positions[seen][:, 0].max()
    cuts = np.linspace(left, right, 8)
    edges = [(a, b) for a, b in itertools.combinations(cuts, 2) if (a, b) != (left, right)]
    spread = EDGE * 4.0
    edges = [(a - spread * (a == left), b + spread * (b == right)) for a, b in edges]
    duration = flights.times.max()
    periods = np.geomspace(0.25, 2.5, 12) * duration
    gusts = [(period, phase) for period in periods for phase in np.pi * np.arange(3) / 3.0]
    air = [(u * np.cos(a), u * np.sin(a)) for u in (2.0, 5.0) for a in np.pi * np.arange(6) / 3.0]
    return {
        "gravity_error": Law(1, lambda t, s, g, p: (p[0] * g[0], p[0] * g[1])),
        "linear_drag": Law(1, drag),
        "quadratic_drag": Law(1, quadratic),
        "lift": Law(1, lambda t, s, g, p: (-p[0] * s[3], p[0] * s[2])),
        "camera_tilt": Law(1, tilt),
        "wind": Law(2, lambda t, s, g, p: (p[0], p[1])),
        "position_field": Law(4, lambda t, s, g, p: (p[0] - p[2] * s[0], p[1] - p[3] * s[1])),
        "moving_air": Law(1, moving_air, air),
        "gust": Law(2, gust, gusts),
        "sticky_patch": Law(1, patch, edges, edges=True),
    }


#: Laws that are special cases of others: a set with both has a parameter that no flight tells.
CONTAINED = {("gravity_error", "wind"), ("gravity_error", "position_field"), ("wind", "position_field"), ("camera_tilt", "wind"),
             ("camera_tilt", "position_field")}


class Model:
    """A set of laws, and its paths."""

    def __init__(self, flights, members):
        self.flights, self.members = flights, members
        self.count = sum(law.count for law in members)
        refined = EDGE_STEPS if any(law.edges for law in members) else 1
        self.steps = refined * int(np.ceil(flights.times.max() / STEP))
        self.h = flights.times[:, -1] / self.steps
        self.weights = interpolation(flights.times, self.h, self.steps)

    def slope(self, t, s, p):
        g, at = self.flights.gravity, 0
        out = np.empty_like(s)
        out[:2], out[2], out[3] = s[2:], g[0], g[1]
        for law in self.members:
            x, y = law.acceleration(t, s, g, p[at:at + law.count])
            out[2] += x
            out[3] += y
            at += law.count
        return out

    def paths(self, p, starts):
        """Positions (copies, trials, points, 2) for parameters (count, copies) and starts (4, copies, trials)."""
        p, h, s = p[:, :, None], self.h, starts
        nodes = np.empty((self.steps + 1, *starts.shape))
        nodes[0] = s
        for k in range(self.steps):
            t = k * h
            k1 = self.slope(t, s, p)
            k2 = self.slope(t + h / 2.0, s + h / 2.0 * k1, p)
            k3 = self.slope(t + h / 2.0, s + h / 2.0 * k2, p)
            k4 = self.slope(t + h, s + h * k3, p)
            s = s + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
            nodes[k + 1] = s
        # (trials, nodes and whether velocity, copies and axis)
        copies, trials = starts.shape[1:]
        values = nodes.reshape(self.steps + 1, 2, 2, copies, trials).transpose(4, 0, 1, 3, 2)
        values = values.reshape(trials, 2 * (self.steps + 1), 2 * copies)
        seen = self.weights @ values
        return seen.reshape(trials, -1, copies, 2).transpose(2, 0, 1, 3)

    def residuals(self, paths):
        """Measured minus predicted (copies, trials, coordinates)."""
        left = (self.flights.positions - paths) * self.flights.weights[:, :, None]
        return left.reshape(*left.shape[:2], -1)


def interpolation(times, h, steps):
    """Weights of cubic Hermite interpolation: (trials, points, nodes times (position, velocity))."""
    trials, points = times.shape
    at = np.minimum((times / h[:, None]).astype(int), steps - 1)
    u = times / h[:, None] - at
    out = np.zeros((trials, points, steps + 1, 2))
    i, k = np.ogrid[:trials, :points]
    width = h[:, None]
    out[i, k, at, 0], out[i, k, at + 1, 0] = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u * u * (3.0 - 2.0 * u)
    out[i, k, at, 1], out[i, k, at + 1, 1] = width * u * (1.0 - u) ** 2, width * u * u * (u - 1.0)
    return out.reshape(trials, points, -1)


def differences(model, p, starts):
    """Residuals, and derivatives of paths by start states (trials, coordinates, 4) and parameters (trials, coordinates, count)."""
    steps = np.maximum(1e-4 * np.abs(p), 1e-5)
    count, copies = len(p), 1 + 4 + len(p)
    all_p = np.repeat(p[:, None], copies, axis=1)
    all_p[np.arange(count), 5 + np.arange(count)] += steps
    all_s = np.repeat(starts[:, None], copies, axis=1)
    all_s[np.arange(4), 1 + np.arange(4)] += 1e-4
    left = model.residuals(model.paths(all_p, all_s))
    change = left[0] - left[1:]
    by_start = change[:4].transpose(1, 2, 0) / 1e-4
    by_parameter = change[4:].transpose(1, 2, 0) / steps
    return left[0], by_start, by_parameter


def projected(left, by_start, by_parameter):
    """Normal equations of the parameters with start states eliminated, and what gives the start states back."""
    transposed = by_start.transpose(0, 2, 1)
    own = transposed @ by_start + 1e-12 * np.eye(4)
    of_parameter = np.linalg.solve(own, transposed @ by_parameter)
    of_left = np.linalg.solve(own, transposed @ left[:, :, None])[:, :, 0]
    free = by_parameter - by_start @ of_parameter
    return np.einsum("nik,nil->kl", free, free), np.einsum("nik,ni->k", free, left), of_parameter, of_left


def fit(model, p, starts):
    """Least squares from a starting point: residual sum of squares, parameters, start states."""
    damping, rss = 1e-4, np.inf
    for _ in range(ITERATIONS):
        left, by_start, by_parameter = differences(model, p, starts)
        before = (left ** 2).sum()
        if not np.isfinite(before) or not np.isfinite(by_parameter).all():
            return np.inf, p, starts
        normal, gradient, of_parameter, of_left = projected(left, by_start, by_parameter)
        for _ in range(5):
            scale = np.diag(normal) + 1e-12
            dp = np.linalg.lstsq(normal + damping * np.diag(scale), gradient, rcond=1e-14)[0] if len(p) else p
            ds = (of_left - of_parameter @ dp).T
            new = model.residuals(model.paths((p + dp)[:, None], (starts + ds)[:, None]))
            rss = (new ** 2).sum()
            # Also false where a path leaves the range of numbers.
            if rss <= before:
                break
            damping *= 10.0
        else:
            return before, p, starts
        p, starts, damping = p + dp, starts + ds, max(damping / 10.0, 1e-9)
        if before - rss <= DECREASE * rss:
            break
    return rss, p, starts


def candidates(flights, members, law, base):
    """Starting points of a set with one law more, given the fit of the others: the most promising points of the law's grid."""
    rss, p, starts = base
    model = Model(flights, [*members, law])
    shapes, count = law.shapes, law.amplitudes
    amount = 1e-3
    # One copy for the fit, then each amplitude at each point of the grid.
    copies = 1 + len(shapes) * count
    all_p = np.zeros((len(p) + law.count, copies))
    all_p[:len(p)] = p[:, None]
    all_p[len(p) + count:] = np.concatenate([shapes[:1], np.repeat(shapes, count, axis=0)]).T
    for a in range(count):
        all_p[len(p) + a, 1 + a::count] = amount
    left = model.residuals(model.paths(all_p, np.repeat(starts[:, None], copies, axis=1)))
    columns = (left[0] - left[1:]) / amount
    own, by_start, by_parameter = differences(Model(flights, members), p, starts)
    promising = []
    for i, shape in enumerate(shapes):
        joint = np.concatenate([by_parameter, columns[i * count:(i + 1) * count].transpose(1, 2, 0)], axis=2)
        normal, gradient, _, _ = projected(own, by_start, joint)
        size = np.linalg.lstsq(normal, gradient, rcond=1e-12)[0]
        point = np.concatenate([p + size[:len(p)], size[len(p):], shape])
        promising.append((gradient @ size, i, point))
    promising.sort(key=lambda one: (-one[0], one[1]))
    return model, [(rss - gain, point) for gain, _, point in promising[:STARTS[min(len(members), 1)]]]


class Search:
    """Fits of every set of at most two laws: residual sum of squares, parameters, start states."""

    def __init__(self, flights):
        self.flights, self.laws = flights, laws(flights)
        self.n, self.trials = flights.number(), len(flights.times)
        starts = np.concatenate([flights.positions[:, 0].T, np.zeros((2, self.trials))])
        self.fits = {(): fit(Model(flights, []), np.zeros(0), starts)}
        for name in self.laws:
            self.extend((), name)
        for pair in itertools.combinations(self.laws, 2):
            if pair not in CONTAINED and pair[::-1] not in CONTAINED:
                self.extend(pair[:1], pair[1])
                self.extend(pair[1:], pair[0])

    def parameters(self, names):
        """Number of parameters of a set, those of trials and noise included."""
        return sum(self.laws[name].count for name in names) + 4 * self.trials + 1

    def bic(self, names, rss):
        return self.n * np.log(rss / self.n) + self.parameters(names) * np.log(self.n)

    def extend(self, names, further):
        """Fits a set with one law more, from the fit without it."""
        base = self.fits[names]
        model, points = candidates(self.flights, [self.laws[name] for name in names], self.laws[further], base)
        together = tuple(name for name in self.laws if name in (*names, further))
        lowest = min(self.bic(own, found[0]) for own, found in self.fits.items())
        for promised, point in points:
            hoped = max(base[0] - GAIN_MARGIN * (base[0] - promised), 1e-3 * base[0])
            if names and self.bic(together, hoped) > lowest + RIVAL:
                continue
            with np.errstate(all="ignore"):
                found = fit(model, point, base[2])
            if found[0] < self.fits.get(together, (np.inf,))[0]:
                order = np.concatenate([np.full(self.laws[name].count, together.index(name)) for name in (*names, further)])
                self.fits[together] = found[0], found[1][np.argsort(order, kind="stable")], found[2]


def fits(flights):
    """All that a decision needs of the fits: squares and parameters of each set, numbers, the noise and its correlation."""
    search = Search(flights)
    sets = [(list(names), search.parameters(names), float(found[0])) for names, found in search.fits.items()]
    names, (_, p, starts) = min(search.fits.items(), key=lambda one: search.bic(one[0], one[1][0]))
    model = Model(flights, [search.laws[name] for name in names])
    left = model.residuals(model.paths(p[:, None], starts[:, None]))[0].reshape(*flights.times.shape, 2)
    correlation = (left[:, 1:] * left[:, :-1]).sum() / (left ** 2).sum()
    return {"n": search.n, "noise_variance": float(flights.noise_variance), "correlation": float(correlation), "sets": sets}


def decide(found, correlated=False, tested=False):
    """Verdict and sets: those that BIC does not reject, the lowest first, without those that flights cannot distinguish from a smaller one.

    `correlated`: only n (1 - r) / (1 + r) of the residuals count, r being their correlation from point to point; `tested`: unknown if they have
    more than `MISFIT` times the variance of the noise."""
    n, r = found["n"], min(max(found["correlation"], 0.0), 0.95)
    effective = n * (1.0 - r) / (1.0 + r) if correlated else n
    scored = [(effective * np.log(rss / n) + k * np.log(effective), names, rss / (n - k)) for names, k, rss in found["sets"]]
    lowest = min(bic for bic, _, _ in scored)
    # The fewest laws first among those that are the same.
    scored.sort(key=lambda one: (round((one[0] - lowest) / SAME), len(one[1]), one[0]))
    kept = [scored[0]]
    for one in scored[1:]:
        same = [other for other in kept if abs(one[0] - other[0]) < SAME and len(one[1]) > len(other[1])]
        if one[0] - lowest < RIVAL and not same:
            kept.append(one)
    if tested and kept[0][2] > MISFIT * found["noise_variance"]:
        return "Unknown", []
    return "Named" if kept[0][1] else "None", [names for _, names, _ in kept]
