"""Figures of what the client gives, by matplotlib: `pip install 'iplw[plot]'`.

    found = client.iplw("bowling", world="bowling-real").wait()
    iplw.plot.latents({"3 rounds": found}, truth={"friction": 0.71})

Each function draws on `ax`, or on the current figure's axes, and returns the axes; nothing is shown or saved. What was
computed elsewhere goes in as pandas frames or arrays, as each says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .results import Diagnosis, Estimate, Score, Training
from .results import weighted as weighted
from .rollout import Rollout, Rollouts
from .rows import Rounds

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

__all__ = ["actions", "auccess", "latents", "residuals", "rivals", "rounds", "training", "trajectory"]

#: Bodies whose name is a colour have it.
_NAMED = {"green": "tab:green", "blue": "tab:blue", "red": "tab:red"}

#: An estimate, or a frame of one: `name,value,low,high,identifiable`.
Known: TypeAlias = "Estimate | pandas.DataFrame"
#: A score, or (attempts,) the share of tasks solved within 1, 2, ... attempts.
Curve: TypeAlias = "Score | ArrayLike"


def trajectory(
    what: Rollout | Rollouts | pandas.DataFrame, *, scene: Mapping[str, Any] | None = None, ax: Axes | None = None
) -> Axes:
    """The ways of bodies through a scene, m.

    `what`: a rollout, many, or a frame `t,body,x,y` (with `trial` where there are several). `scene` is that of the
    rollout where it is known.
    """
    ax = _axes(ax)
    if isinstance(what, Rollout):
        scene = scene or what.placed
        ways = list(what.bodies.items())
    elif isinstance(what, Rollouts):
        ways = [way for one in what for way in one.bodies.items()]
        scene = scene or next((one.scene for one in what if one.scene is not None), None)
    else:
        keys = [name for name in ("trial", "body") if name in what.columns]
        ways = [(str(k[-1]), part[["x", "y"]].to_numpy()) for k, part in what.groupby(keys, sort=False)]
    _scene(ax, scene, fixed=isinstance(what, Rollout))
    several = len(ways) > len({name for name, _ in ways})
    named = set()
    for name, states in ways:
        label = None if name in named else name
        named.add(name)
        (line,) = ax.plot(states[:, 0], states[:, 1], color=_NAMED.get(name), lw=0.8 if several else 1.6, label=label)
        if not several and len(states):
            ax.plot(*states[-1, :2], "o", color=line.get_color(), ms=5)
    ax.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    ax.legend(frameon=False, fontsize="small")
    return ax


def actions(
    tried: ArrayLike,
    solved: Rollouts | ArrayLike,
    *,
    components: tuple[int, int] = (0, 1),
    bins: int = 12,
    ax: Axes | None = None,
) -> Axes:
    """A heat map of actions: the share that solved the task, over two components of the action.

    `tried` (n, dimension) and `solved`: the rollouts, whose actions that could not be placed are left out, or (n,)
    numbers, whose mean is drawn; NaN is left out. White where no action fell.
    """
    ax = _axes(ax)
    table = np.asarray(tried, dtype=np.float64)
    if isinstance(solved, Rollouts):
        values = np.where(solved.valid, solved.solved.astype(np.float64), np.nan)
    else:
        values = np.asarray(solved, dtype=np.float64)
    if table.ndim != 2 or values.shape != table.shape[:1]:
        raise ValueError(f"tried has shape {table.shape}, solved {values.shape}; allowed: (n, dimension) and (n,)")
    kept = np.isfinite(values)
    first, second = (table[kept, i] for i in components)
    edges = np.linspace(0.0, 1.0, bins + 1)
    counts, _, _ = np.histogram2d(first, second, bins=[edges, edges])
    sums, _, _ = np.histogram2d(first, second, bins=[edges, edges], weights=values[kept])
    share = np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0)
    drawn = ax.pcolormesh(edges, edges, share.T, cmap="viridis", vmin=0.0)
    ax.figure.colorbar(drawn, ax=ax, label="share that solves")
    ax.set(xlabel=f"action[{components[0]}]", ylabel=f"action[{components[1]}]", aspect="equal")
    return ax


def latents(
    known: Known | Mapping[str, Known], *, truth: Mapping[str, float] | None = None, ax: Axes | None = None
) -> Axes:
    """Latents with their 95 % intervals, a row each; several estimates by name stand above each other.

    What the trials do not tell is left out. `truth` is marked where it is given.
    """
    ax = _axes(ax)
    many = known if isinstance(known, Mapping) and not isinstance(known, Estimate) else {"": known}
    frames = {label: one.frame() if isinstance(one, Estimate) else one for label, one in many.items()}
    names = list(dict.fromkeys(name for frame in frames.values() for name in frame["name"][frame["identifiable"]]))
    for i, (label, frame) in enumerate(frames.items()):
        rows = frame[frame["identifiable"]]
        at = np.array([names.index(name) for name in rows["name"]], dtype=float) + 0.16 * (i - (len(frames) - 1) / 2)
        value = rows["value"].to_numpy(dtype=float)
        ends = np.abs(rows[["low", "high"]].to_numpy(dtype=float).T - value)
        ax.errorbar(value, at, xerr=np.nan_to_num(ends), fmt="o", ms=4, capsize=3, label=label or None)
    for name, value in (truth or {}).items():
        if name in names:
            ax.plot(
                [value], [names.index(name)], "k|", ms=16, label="truth" if name == next(iter(truth or {})) else None
            )
    ax.set_yticks(range(len(names)), names)
    ax.set(xlabel="value, with 95 % interval", ylim=(len(names) - 0.5, -0.5))
    if ax.get_legend_handles_labels()[1]:
        ax.legend(frameon=False, fontsize="small")
    return ax


def rounds(course: Rounds | pandas.DataFrame, name: str, *, truth: float | None = None, ax: Axes | None = None) -> Axes:
    """What was known of one latent, over the real interactions spent; rounds that do not tell it are left out.

    `course`: `job.rounds()`, or its frame.
    """
    ax = _axes(ax)
    frame = course.frame() if isinstance(course, Rounds) else course
    rows = frame[(frame["name"] == name) & frame["identifiable"]]
    if not (frame["name"] == name).any():
        raise ValueError(f"name is {name!r}; allowed: {', '.join(dict.fromkeys(frame['name']))}")
    ax.fill_between(rows["interactions"], rows["low"], rows["high"], alpha=0.2, lw=0)
    # One round alone has no width to fill.
    ends = np.abs(rows[["low", "high"]].to_numpy(dtype=float).T - rows["value"].to_numpy(dtype=float))
    ax.errorbar(rows["interactions"], rows["value"], yerr=np.nan_to_num(ends), fmt="o-", ms=4, capsize=3)
    if truth is not None:
        ax.axhline(truth, color="k", lw=1, ls="--", label="truth")
        ax.legend(frameon=False, fontsize="small")
    ax.set(xlabel="real interactions", ylabel=name)
    return ax


def auccess(scores: Curve | Mapping[str, Curve], *, ax: Axes | None = None) -> Axes:
    """The share of tasks solved within so many attempts, of one policy or of several by name, with their AUCCESS."""
    ax = _axes(ax)
    many = scores if isinstance(scores, Mapping) and not isinstance(scores, Score) else {"": scores}
    for label, one in many.items():
        curve = one.solved_within if isinstance(one, Score) else np.asarray(one, dtype=np.float64)
        if curve.ndim != 1 or not len(curve) or not (0 <= curve.min() and curve.max() <= 1):
            where = f"scores[{label!r}]" if label else "scores"
            raise ValueError(f"{where} is {one!r}; allowed: a Score, or shares solved within 1, 2, ... tries, 0 to 1")
        value = one.auccess if isinstance(one, Score) else weighted(curve)
        ax.step(np.arange(1, len(curve) + 1), curve, where="post", label=f"{label} {value:.3f}".strip())
    ax.set(xscale="log", xlabel="attempts", ylabel="share of tasks solved", ylim=(-0.02, 1.02))
    ax.legend(title="AUCCESS", frameon=False, fontsize="small")
    return ax


def rivals(found: Diagnosis | pandas.DataFrame, *, most: int = 10, ax: Axes | None = None) -> Axes:
    """Sets of effects that could explain the trials: nats behind the reported one; those that
    the data cannot tell from it are coloured.

    A diagnosis, or its `scores()`. The scale is logarithmic beyond one nat.
    """
    ax = _axes(ax)
    frame = (found.scores() if isinstance(found, Diagnosis) else found).head(most)
    behind = -frame["score"].to_numpy(dtype=float)
    colours = np.where(frame["rival"].to_numpy(dtype=bool), "tab:orange", "lightgrey")
    ax.barh(np.arange(len(frame)), np.maximum(behind, 0.0), color=colours)
    ax.plot(np.zeros(len(frame)), np.arange(len(frame)), "|", color="0.4", ms=8)
    ax.set_yticks(range(len(frame)), list(frame["effects"]))
    ax.set_xscale("symlog", linthresh=1.0)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set(xlabel="nats behind the reported set", ylim=(len(frame) - 0.5, -0.5), xlim=(0, None))
    return ax


def residuals(found: Diagnosis | pandas.DataFrame, *, axis: str = "y", ax: Axes | None = None) -> Axes:
    """What is left between seen and simulated, mm over time: by the base model, and with what was found.

    A diagnosis, or its `points()`: a frame with `t,before_x,before_y,after_x,after_y`. `axis`: `x` or `y`.
    """
    if axis not in ("x", "y"):
        raise ValueError(f"axis is {axis!r}; allowed: x, y")
    ax = _axes(ax)
    frame = found.points() if isinstance(found, Diagnosis) else found
    for when, label, colour in (("before", "base model", "tab:red"), ("after", "with what was found", "tab:blue")):
        ax.plot(frame["t"], 1e3 * frame[f"{when}_{axis}"], ".", ms=3, color=colour, alpha=0.6, label=label)
    ax.axhline(0.0, color="0.5", lw=0.8)
    ax.set(xlabel="t (s)", ylabel=f"seen - simulated, {axis} (mm)")
    ax.legend(frameon=False, fontsize="small", markerscale=3)
    return ax


def training(told: Training | pandas.DataFrame, *, ax: Axes | None = None) -> Axes:
    """The loss of each batch, nats, and AUCCESS on validation tasks at the right, where it was looked at."""
    ax = _axes(ax)
    frame = told.frame() if isinstance(told, Training) else told
    ax.plot(frame.index, frame["loss"], color="0.7", lw=0.8)
    smooth = frame["loss"].rolling(max(1, len(frame) // 20), min_periods=1).mean()
    ax.plot(frame.index, smooth, color="tab:blue", label="loss")
    ax.set(xlabel="batches", ylabel="loss (nats)")
    seen = frame["auccess"].dropna()
    if len(seen):
        right = ax.twinx()
        right.plot(seen.index, seen, "o-", color="tab:orange", ms=4)
        right.set(ylabel="AUCCESS, validation tasks", ylim=(0, 1))
    return ax


def _axes(ax: Axes | None) -> Axes:
    """The axes to draw on."""
    if ax is not None:
        return ax
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError(
            "iplw.plot draws with matplotlib, which is not installed: pip install 'iplw[plot]'"
        ) from error
    return plt.gca()


def _scene(ax: Axes, scene: Mapping[str, Any] | None, fixed: bool) -> None:
    """Statics, and bodies where they start: outlines of what is a disc, a box or a polygon."""
    from matplotlib.patches import Circle, Polygon

    for thing in [*(scene or {}).get("statics", []), *((scene or {}).get("bodies", []) if fixed else [])]:
        if "position" not in thing and thing in (scene or {}).get("bodies", []):
            continue
        shape, (x, y), angle = thing["shape"], thing.get("position", (0.0, 0.0)), thing.get("angle", 0.0)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        style: dict[str, Any] = {"fill": False, "ec": "0.6", "lw": 1.0}
        if shape["type"] == "disc":
            ax.add_patch(Circle((x, y), shape["radius"], **style, ls="--"))
        elif (corners := _corners(shape)) is not None:
            ax.add_patch(Polygon(corners @ turn + (x, y), closed=len(corners) > 2, **style))
    ax.autoscale_view()


def _corners(shape: Mapping[str, Any]) -> NDArray[np.float64] | None:
    if shape["type"] == "box":
        w, h = shape["half_width"], shape["half_height"]
        return np.array([[-w, -h], [w, -h], [w, h], [-w, h]], dtype=float)
    if shape["type"] == "polygon":
        return np.array(shape["vertices"], dtype=float)
    return np.array([shape["from"], shape["to"]], dtype=float) if shape["type"] == "segment" else None
