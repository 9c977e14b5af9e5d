"""Interactive figures of the workbench, as plain plotly dicts in engineering units; and what an error depends on.

Play and stiction show in the time since OP turned, a curved or stopped valve in the level of OP, a slow actuator in its
speed, loads in the time of the record, swings from outside in one frequency."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from ..record import BoolArray, FloatArray, IntArray, LoopSettings
from ..results import Region, Series, Step
from ..words import WORDS
from . import figures as fig
from .figures import Figure
from .safe import picture
from .words import error_size, fails, plain_name, rung

PREDICTED, RESIDUAL = fig.EVIDENCE, "#7a5bc7"  # of a single model; the regions shaded are red first
STEP_COLOURS = (fig.QUIET, fig.EVIDENCE, fig.GREEN, RESIDUAL, "#b8578f", "#5a6b00")
SHADES = ("#d1345b2e", "#c777002e", "#2a9d5c2e", "#7a5bc72e", "#0b8a9e2e", "#8d99a538")
POINTS = 4000  # per line: a page of five steps stays below 3 MB
DIGITS = 5  # of the span: residuals are small beside it
USUAL = 0.99  # share of the residuals that the axis shows at least
REACH = 5  # samples to each side, for the speed of OP
BINS = 12
FEWEST = 8  # samples in a bin that is drawn
Binned = tuple[FloatArray, FloatArray, FloatArray]  # x, mean and root mean square of a residual [PV span], each (bins,)
NOTHING: Binned = (np.empty(0), np.empty(0), np.empty(0))


def overlay(series: Series, models: Mapping[str, FloatArray], settings: LoopSettings, noise_floor: float,
            regions: Sequence[Region] = ()) -> Figure:
    """Measured PV with the prediction of each model, what each leaves, and OP, on one time axis. models: name -> PV
    (samples,); of several, buttons choose which are shown. regions: the worst of them are shaded."""
    ((low, high), pv_unit), (op_span, op_unit) = fig.shown(settings.pv_range), fig.shown(settings.op_range)
    line = partial(fig.over_time, series.time, points=POINTS, digits=DIGITS, connectgaps=False, width=1.4)
    lines = [line(series.setpoint, (low, high), "SP", fig.SETPOINT, width=1.2, dash="dot"), line(series.measured, (
        low, high), "PV measured", fig.MEASUREMENT), line(series.output, op_span, "OP", fig.OUTPUT, yaxis="y3")]
    for name, values in series.inside.items():  # where the stem is as the model sees it where it does not follow OP
        if not np.allclose(values, series.output, rtol=0.0, atol=1e-9):
            lines.append(line(values, op_span, "stem (model)" if name == "valve" else plain_name(name),
                              fig.STEM, yaxis="y3", dash="dash"))
    last, always, reach = len(models) - 1, len(lines), 0.0
    rests = [series.residual(prediction) for prediction in models.values()]
    for place, ((name, prediction), rest) in enumerate(zip(models.items(), rests, strict=True)):
        colour, left = (STEP_COLOURS[place % len(STEP_COLOURS)],) * 2 if last else (PREDICTED, RESIDUAL)
        look: Figure = {"visible": place in (0, last), "legendgroup": name}
        lines += [line(prediction, (low, high), name, colour, **look),  # a difference has the scale of PV, not its zero
                  line(rest, (0.0, high - low), f"residual, {name}", left, yaxis="y2", showlegend=False, **look)]
        if np.isfinite(rest).any():
            reach = max(reach, (high - low) * float(np.nanquantile(np.abs(rest), USUAL)))
    shaded = [r for r in (fails(regions) or regions) if r.stretches]
    for region, shade in zip(shaded, SHADES, strict=False):  # filled behind the residual, switched by the legend
        ends = [(fig.ms(first), fig.ms(last)) for first, last in region.stretches]
        lines.append(fig.trace([x for a, b in ends for x in (a, a, b, b, None)], [0, 1, 1, 0, None] * len(ends),
            region.region, fig.QUIET, width=0, hover="", hoverinfo="skip", yaxis="y4", fill="tozeroy", fillcolor=shade,
            visible=True if region is shaded[0] else "legendonly"))
    band = 2 * noise_floor * (high - low)
    panels = fig.axis(f"SP, PV [{pv_unit}]", domain=[0.52, 1.0]), fig.axis(
        "residual [as PV]", domain=[0.25, 0.46]), fig.axis(f"OP [{op_unit}]", domain=[0.0, 0.19])
    if reach:  # a model is often far off in its first seconds; the lines go on beyond the axis
        panels[1]["range"] = [side * 1.5 * max(reach, band) for side in (-1.0, 1.0)]
    layout: Figure = {"hovermode": "x", "height": 640,
        "yaxis4": {"overlaying": "y2", "range": [0, 1], "fixedrange": True, "visible": False, "side": "right"},
        "shapes": [fig.across("y", y, fig.QUIET, dash="dot", yref="y2") for y in (-band, band)]}
    if last > 0:  # numbers, not names: buttons do not wrap on a narrow screen
        numbers = [name.partition(":")[0] for name in models]
        wanted = {**{number: {k} for k, number in enumerate(numbers)}, f"{numbers[0]} + {numbers[-1]}": {0, last},
                  "all": set(range(last + 1))}
        buttons = [{"label": label, "method": "restyle", "args": [{"visible": [True] * always + [
            place in chosen for place in range(last + 1) for _ in range(2)]}]} for label, chosen in wanted.items()]
        layout |= {"margin": {"b": 90}, "updatemenus": [{
            "type": "buttons", "direction": "right", "x": 0, "xanchor": "left", "y": -0.12, "yanchor": "top",
            "active": -1, "showactive": True, "bgcolor": "#f2f4f6", "font": {"color": "#1d2733"}, "buttons": buttons}]}
    return fig.figure(lines, fig.DATES, *panels, **layout)


def ladder_bars(steps: Sequence[Step], noise_floor: float) -> Figure:
    """The hold-out error after each step, from the top down, beside the noise floor."""
    errors, floor = [round(100 * s.rmse_holdout, 5) for s in steps], 100 * noise_floor
    bars = {"type": "bar", "orientation": "h", "y": [f"{k}  {picture(rung(s))}" for k, s in enumerate(steps)],
            "x": errors, "text": [error_size(s.rmse_holdout) for s in steps], "textposition": "outside",
            "cliponaxis": False, "textangle": 0, "hovertemplate": "%{y}: %{x:.4g} %<extra></extra>",
            "showlegend": False, "width": 0.6,
            "marker": {"color": [STEP_COLOURS[k % len(STEP_COLOURS)] for k in range(len(steps))]}}
    words = fig.written("on unseen samples; dashed: noise floor", 0, 1.0, xref="paper", xanchor="left", yref="paper",
                    yanchor="bottom")
    return fig.figure([bars], fig.axis("error [% of PV span]", range=[0, 1.4 * max([*errors, floor])]),
                      {"type": "category", "autorange": "reversed"}, annotations=[words], height=150 + 48 * len(steps),
                      shapes=[fig.across("x", floor, fig.MEASUREMENT, width=1.5, dash="dash")])


def plane(series: Series, settings: LoopSettings) -> Figure:
    """PV against OP, measured and predicted: with play or stiction the path is a leaning box."""
    every = slice(None, None, max(1, len(series.time) // POINTS))
    (pv_span, pv_unit), (op_span, op_unit) = fig.shown(settings.pv_range), fig.shown(settings.op_range)
    op = fig.units(series.output[every], op_span, DIGITS)
    lines = [fig.trace(op, fig.units(np.where(series.used, values, np.nan)[every], pv_span, DIGITS), name,
                       colour, width=1, opacity=0.7, hover="OP %{x}, PV %{y}")
             for name, values, colour in (("measured", series.measured, fig.MEASUREMENT),
                                          ("predicted", series.predicted, PREDICTED))]
    return fig.figure(lines, fig.axis(f"OP [{op_unit}]"), fig.axis(f"PV [{pv_unit}]"), height=440)


def causes(series: Series, predictions: Mapping[str, FloatArray], noise_floor: float) -> list[tuple[str, str, Figure]]:
    """Residuals of each model against what they may depend on: title, what to see, figure. predictions: model -> PV."""
    h = float(np.median(np.diff(series.time))) if len(series.time) > 1 else 1.0
    since, upward = since_reversal(series.output)
    early = (since >= 0) & (since < np.quantile(since[since >= 0], 0.9) if np.any(since >= 0) else False)
    near = np.clip(np.add(np.arange(len(since)), [[-REACH], [REACH]]), 0, len(since) - 1)
    (change,), (steps,) = np.diff(series.output[near], axis=0), np.diff(near, axis=0)
    speed, clock = 100 * np.abs(change) / (np.maximum(steps, 1) * h), (series.time - series.time[0]) / 3600.0
    mean, size, linear = "mean residual", "residual (rms)", "linear"
    shown: list[tuple[str, str, str, Callable[[FloatArray], dict[str, Binned]]]] = [
        ("turned", linear, mean, lambda r: {
            f", OP turned {word}": binned(since * h, r, early & (upward == up), even=True)
            for up, word in ((1, "up"), (-1, "down"))}),
        ("level", linear, mean, lambda r: {"": binned(100 * series.output, r)}),
        ("speed", linear, size, lambda r: {"": binned(speed, r)}),
        ("time", linear, mean, lambda r: {"": binned(clock, r, even=True, bins=3 * BINS)}),
        ("period", "log", size, lambda r: {"": spectrum(r, h)})]
    colours = [PREDICTED] if len(predictions) == 1 else [fig.QUIET, STEP_COLOURS[2]]
    looks, found = (("solid", "circle"), ("dash", "circle-open")), []
    for name, scale, y_label, curves in shown:
        (title, x_label, note), lines = WORDS["causes"][name], []
        for (model, prediction), colour in zip(predictions.items(), colours, strict=True):
            parts = curves(series.residual(prediction)).items()
            for (part, (x, *ys)), (dash, symbol) in zip(parts, looks, strict=False):
                lines.append(fig.trace(fig.digits(x), fig.digits(100 * ys[y_label == size]), model + part, colour,
                                       mode="lines+markers", size=6, width=1.6, dash=dash, symbol=symbol,
                                       hover="%{x:.4g}: %{y:.3g} %"))
        level = 0.0 if y_label == mean else 100 * noise_floor
        shapes = [fig.across("y", level, fig.QUIET, dash="dot")] if scale == linear else []
        if lines := [line for line in lines if line["x"]]:
            found.append((title, note, fig.figure(lines, fig.axis(x_label, type=scale), fig.axis(
                f"{y_label} [% of PV span]"), height=320, shapes=shapes)))
    return found


def binned(x: FloatArray, residual: FloatArray, where: BoolArray | bool = True, *, even: bool = False,
           bins: int = BINS) -> Binned:
    """Return centre, mean and rms of a residual (samples,) in bins of x: of even width, or with evenly many samples."""
    from scipy.stats import binned_statistic
    chosen = where & np.isfinite(residual) & np.isfinite(x)
    xs, rs = x[chosen], residual[chosen]
    if len(xs) < 2 * FEWEST or np.ptp(xs) == 0.0:
        return NOTHING
    shares = np.linspace(0.0, 1.0, bins + 1)
    edges = xs.min() + shares * np.ptp(xs) if even else np.unique(np.quantile(xs, shares))
    means, _, place = binned_statistic(xs, [xs, rs, rs**2], "mean", bins=edges)
    center, mean, square = means[:, np.bincount(place - 1, minlength=len(edges) - 1) >= FEWEST]
    return center, mean, np.sqrt(square)


def spectrum(residual: FloatArray, h: float) -> Binned:
    """Return the size of a residual by period [s]: its rms in thirds of an octave, the mean 0; holes count as 0."""
    good = np.isfinite(residual)
    n = len(residual)
    if np.count_nonzero(good) < 64:
        return NOTHING
    values = np.where(good, residual - np.mean(residual[good]), 0.0)
    power = np.abs(np.fft.rfft(values)[1:]) ** 2 * 2.0 / (n * np.count_nonzero(good))
    period = n * h / np.arange(1, len(power) + 1)
    band = np.floor(3.0 * np.log2(period / (2.0 * h)) + 0.5).astype(np.int64)
    _, place, count = np.unique(band, return_inverse=True, return_counts=True)
    x = np.exp(np.bincount(place, np.log(period)) / count)
    return x, np.zeros(len(x)), np.sqrt(np.bincount(place, power))


def since_reversal(output: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return samples since OP last turned (-1 before the first turn) and where it goes since (1 up, -1 down). A turn
    counts when OP then goes on by more than its own noise and 2 % of its travel."""
    from scipy.signal import find_peaks
    third, count = np.diff(output, 3), np.arange(len(output))
    noise = float(np.sqrt(np.nanmean(third**2) / 20.0)) if third.size else 0.0
    least = max(4.0 * noise, 0.02 * float(np.nanmax(output) - np.nanmin(output)), 1e-9)
    known = np.flatnonzero(np.isfinite(output))
    whole = np.interp(count, known, output[known])
    goes = np.zeros(len(output), dtype=np.int64)
    for sign in (1, -1):
        goes[find_peaks(-sign * whole, prominence=least, plateau_size=1)[1]["left_edges"]] = sign
    turns = np.flatnonzero(goes)
    turns = turns[np.diff(goes[turns], prepend=0) != 0]  # of stops of the same height the first is the turn
    last = np.append(turns, len(output))[np.searchsorted(turns, count, side="right") - 1]  # the end before the first
    before = count < last
    return np.where(before, -1.0, count - last), np.where(before, 0, np.append(goes, 0)[last])


