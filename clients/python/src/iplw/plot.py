"""Matplotlib figures of results: `pip install 'iplw[plot]'`.

    estimate = client.iplw("bowling", world="bowling-real").wait()
    iplw.plot.latents({"3 rounds": estimate}, truth={"friction": 0.71})

Each function draws on `ax` (default: the current axes) and returns the axes; it neither shows nor saves the figure. All
accept pandas frames or arrays in place of results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .display.theme import colour
from .results import Diagnosis, Estimate, Score, Training
from .results import weighted as weighted
from .rollout import Rollout, Rollouts
from .rows import Rounds

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

__all__ = ["actions", "auccess", "latents", "residuals", "rivals", "rounds", "training", "trajectory"]

#: Colours of bodies that are named after a colour.
_COLOUR_BY_NAME = {"green": "tab:green", "blue": "tab:blue", "red": "tab:red"}

#: An estimate, or its frame: `name,value,low,high,identifiable`.
EstimateLike: TypeAlias = "Estimate | pandas.DataFrame"
#: A score, or (attempts,) the share of tasks solved within 1, 2, ... attempts.
ScoreLike: TypeAlias = "Score | ArrayLike"


def trajectory(
    rollouts: Rollout | Rollouts | pandas.DataFrame, *, scene: Mapping[str, Any] | None = None, ax: Axes | None = None
) -> Axes:
    """Trajectories of bodies in a scene, m.

    `rollouts`: one rollout, several, or a frame `t,body,x,y` (with `trial` if there are several). `scene`: default: that of
    the rollout.
    """
    ax = _axes(ax)
    if isinstance(rollouts, Rollout):
        scene = scene or rollouts.placed
        tracks = list(rollouts.bodies.items())
    elif isinstance(rollouts, Rollouts):
        tracks = [track for rollout in rollouts for track in rollout.bodies.items()]
        scene = scene or next((rollout.scene for rollout in rollouts if rollout.scene is not None), None)
    else:
        keys = [name for name in ("trial", "body") if name in rollouts.columns]
        tracks = [(str(k[-1]), part[["x", "y"]].to_numpy()) for k, part in rollouts.groupby(keys, sort=False)]
    _scene(ax, scene, with_bodies=isinstance(rollouts, Rollout))
    is_batch = len(tracks) > len({name for name, _ in tracks})
    labelled = set()
    for name, states in tracks:
        label = None if name in labelled else name
        labelled.add(name)
        (line,) = ax.plot(states[:, 0], states[:, 1], color=_COLOUR_BY_NAME.get(name), lw=0.8 if is_batch else 1.6, label=label)
        if not is_batch and len(states):
            ax.plot(*states[-1, :2], "o", color=line.get_color(), ms=5)
    ax.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    ax.legend(frameon=False, fontsize="small")
    return ax


def actions(
    vectors: ArrayLike,
    solved: Rollouts | ArrayLike,
    *,
    components: tuple[int, int] = (0, 1),
    bins: int = 12,
    ax: Axes | None = None,
) -> Axes:
    """A heat map of the share of actions that solve the task, over two components of the action.

    `vectors`: (n, dimension). `solved`: the rollouts, or (n,) numbers, whose mean is drawn. Invalid actions and NaN are
    omitted. Cells without actions are white.
    """
    ax = _axes(ax)
    table = np.asarray(vectors, dtype=np.float64)
    if isinstance(solved, Rollouts):
        values = np.where(solved.valid, solved.solved.astype(np.float64), np.nan)
    else:
        values = np.asarray(solved, dtype=np.float64)
    if table.ndim != 2 or values.shape != table.shape[:1]:
        raise ValueError(f"vectors has shape {table.shape}, solved {values.shape}; allowed: (n, dimension) and (n,)")
    finite = np.isfinite(values)
    first, second = (table[finite, i] for i in components)
    edges = np.linspace(0.0, 1.0, bins + 1)
    counts, _, _ = np.histogram2d(first, second, bins=[edges, edges])
    sums, _, _ = np.histogram2d(first, second, bins=[edges, edges], weights=values[finite])
    share = np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0)
    mesh = ax.pcolormesh(edges, edges, share.T, cmap="viridis", vmin=0.0)
    ax.figure.colorbar(mesh, ax=ax, label="share solved")
    ax.set(xlabel=f"action[{components[0]}]", ylabel=f"action[{components[1]}]", aspect="equal")
    return ax


def latents(
    estimates: EstimateLike | Mapping[str, EstimateLike], *, truth: Mapping[str, float] | None = None, ax: Axes | None = None
) -> Axes:
    """Latents with their 95 % intervals, one row each; `estimates` may be one estimate or several by name.

    Latents that are not identifiable are omitted. `truth` is marked.
    """
    ax = _axes(ax)
    by_label = estimates if isinstance(estimates, Mapping) and not isinstance(estimates, Estimate) else {"": estimates}
    frames = {label: one.frame() if isinstance(one, Estimate) else one for label, one in by_label.items()}
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
                [value], [names.index(name)], "|", color=colour("truth"), ms=16, mew=2, label="truth" if name == next(iter(truth or {})) else None
            )
    ax.set_yticks(range(len(names)), names)
    ax.set(xlabel="value, with 95 % interval", ylim=(len(names) - 0.5, -0.5))
    if ax.get_legend_handles_labels()[1]:
        ax.legend(frameon=False, fontsize="small")
    return ax


def rounds(history: Rounds | pandas.DataFrame, name: str, *, truth: float | None = None, ax: Axes | None = None) -> Axes:
    """The estimate of one latent over real interactions; rounds in which it is not identifiable are omitted.

    `history`: `job.rounds()`, or its frame.
    """
    ax = _axes(ax)
    frame = history.frame() if isinstance(history, Rounds) else history
    rows = frame[(frame["name"] == name) & frame["identifiable"]]
    if not (frame["name"] == name).any():
        raise ValueError(f"name is {name!r}; allowed: {', '.join(dict.fromkeys(frame['name']))}")
    ax.fill_between(rows["interactions"], rows["low"], rows["high"], alpha=0.2, lw=0)
    # fill_between draws nothing for a single round.
    ends = np.abs(rows[["low", "high"]].to_numpy(dtype=float).T - rows["value"].to_numpy(dtype=float))
    ax.errorbar(rows["interactions"], rows["value"], yerr=np.nan_to_num(ends), fmt="o-", ms=4, capsize=3)
    if truth is not None:
        ax.axhline(truth, color=colour("truth"), lw=1, ls="--", label="truth")
        ax.legend(frameon=False, fontsize="small")
    ax.set(xlabel="real interactions", ylabel=name)
    return ax


def auccess(scores: ScoreLike | Mapping[str, ScoreLike], *, ax: Axes | None = None) -> Axes:
    """Share of tasks solved over attempts, with AUCCESS, for one policy or for several by name."""
    ax = _axes(ax)
    many = scores if isinstance(scores, Mapping) and not isinstance(scores, Score) else {"": scores}
    for label, one in many.items():
        curve = one.solved_within if isinstance(one, Score) else np.asarray(one, dtype=np.float64)
        if curve.ndim != 1 or not len(curve) or not (0 <= curve.min() and curve.max() <= 1):
            name = f"scores[{label!r}]" if label else "scores"
            raise ValueError(f"{name} is {one!r}; allowed: a Score, or shares solved within 1, 2, ... attempts, 0 to 1")
        value = one.auccess if isinstance(one, Score) else weighted(curve)
        ax.step(np.arange(1, len(curve) + 1), curve, where="post", label=f"{label} {value:.3f}".strip())
    ax.set(xscale="log", xlabel="attempts", ylabel="share of tasks solved", ylim=(-0.02, 1.02))
    ax.legend(title="AUCCESS", frameon=False, fontsize="small")
    return ax


def rivals(diagnosis: Diagnosis | pandas.DataFrame, *, max_rows: int = 10, ax: Axes | None = None) -> Axes:
    """Score of each set of effects, in nats below the reported set; the credible set is coloured.

    `diagnosis`: a diagnosis, or its `scores()`. The axis is logarithmic beyond one nat.
    """
    ax = _axes(ax)
    frame = (diagnosis.scores() if isinstance(diagnosis, Diagnosis) else diagnosis).head(max_rows)
    nats_below = -frame["score"].to_numpy(dtype=float)
    colours = np.where(frame["rival"].to_numpy(dtype=bool), colour("extended"), colour("line"))
    ax.barh(np.arange(len(frame)), np.maximum(nats_below, 0.0), color=colours)
    ax.plot(np.zeros(len(frame)), np.arange(len(frame)), "|", color="0.4", ms=8)
    ax.set_yticks(range(len(frame)), list(frame["effects"]))
    ax.set_xscale("symlog", linthresh=1.0)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set(xlabel="nats below the reported set", ylim=(len(frame) - 0.5, -0.5), xlim=(0, None))
    return ax


def residuals(diagnosis: Diagnosis | pandas.DataFrame, *, axis: str = "y", ax: Axes | None = None) -> Axes:
    """Residuals (measured - simulated), mm, over time: of the base model and of the extended model.

    `diagnosis`: a diagnosis, or its `points()`: a frame with `t,before_x,before_y,after_x,after_y`. `axis`: `x` or `y`.
    """
    if axis not in ("x", "y"):
        raise ValueError(f"axis is {axis!r}; allowed: x, y")
    ax = _axes(ax)
    frame = diagnosis.points() if isinstance(diagnosis, Diagnosis) else diagnosis
    for phase, label, shade in (("before", "base model", colour("simulated")), ("after", "extended model", colour("extended"))):
        ax.plot(frame["t"], 1e3 * frame[f"{phase}_{axis}"], ".", ms=3, color=shade, alpha=0.6, label=label)
    ax.axhline(0.0, color="0.5", lw=0.8)
    ax.set(xlabel="t (s)", ylabel=f"measured - simulated, {axis} (mm)")
    ax.legend(frameon=False, fontsize="small", markerscale=3)
    return ax


def training(result: Training | pandas.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Loss of each batch, nats, and validation AUCCESS on the right axis."""
    ax = _axes(ax)
    frame = result.frame() if isinstance(result, Training) else result
    ax.plot(frame.index, frame["loss"], color="0.7", lw=0.8)
    smooth = frame["loss"].rolling(max(1, len(frame) // 20), min_periods=1).mean()
    ax.plot(frame.index, smooth, color="tab:blue", label="loss")
    ax.set(xlabel="batches", ylabel="loss (nats)")
    scores = frame["auccess"].dropna()
    if len(scores):
        right = ax.twinx()
        right.plot(scores.index, scores, "o-", color="tab:orange", ms=4)
        right.set(ylabel="AUCCESS, validation tasks", ylim=(0, 1))
    return ax


def _axes(ax: Axes | None) -> Axes:
    """The given axes, or the current ones."""
    if ax is not None:
        return ax
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError(
            "iplw.plot draws with matplotlib, which is not installed: pip install 'iplw[plot]'"
        ) from error
    return plt.gca()


def _scene(ax: Axes, scene: Mapping[str, Any] | None, with_bodies: bool) -> None:
    """Outlines of static objects and of bodies at the start."""
    from matplotlib.patches import Circle, Polygon

    for item in [*(scene or {}).get("statics", []), *((scene or {}).get("bodies", []) if with_bodies else [])]:
        if "position" not in item and item in (scene or {}).get("bodies", []):
            continue
        shape, (x, y), angle = item["shape"], item.get("position", (0.0, 0.0)), item.get("angle", 0.0)
        rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        style: dict[str, Any] = {"fill": False, "ec": "0.6", "lw": 1.0}
        if shape["type"] == "disc":
            ax.add_patch(Circle((x, y), shape["radius"], **style, ls="--"))
        elif (corners := _corners(shape)) is not None:
            ax.add_patch(Polygon(corners @ rotation + (x, y), closed=len(corners) > 2, **style))
    ax.autoscale_view()


def _corners(shape: Mapping[str, Any]) -> NDArray[np.float64] | None:
    if shape["type"] == "box":
        w, h = shape["half_width"], shape["half_height"]
        return np.array([[-w, -h], [w, -h], [w, h], [-w, h]], dtype=float)
    if shape["type"] == "polygon":
        return np.array(shape["vertices"], dtype=float)
    return np.array([shape["from"], shape["to"]], dtype=float) if shape["type"] == "segment" else None
