"""Interactive figures of the workbench, as plain plotly dicts in engineering units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..record import FloatArray, LoopSettings
from ..results import Region, Series, Step
from .explain_words import error_size, fails, inside_name, plain_name
from .figures import EVIDENCE, MEASUREMENT, OUTPUT, QUIET, SETPOINT, STEM, Figure, thin, units
from .residual_causes import Cause
from .safe import picture

PREDICTED, RESIDUAL = EVIDENCE, "#7a5bc7"
STEP_COLOURS = (QUIET, EVIDENCE, "#2a9d5c", "#7a5bc7", "#b8578f", "#5a6b00")
SHADES = ("rgba(209,52,91,0.18)", "rgba(199,119,0,0.18)", "rgba(42,157,92,0.18)", "rgba(122,91,199,0.18)",
          "rgba(11,138,158,0.18)", "rgba(141,153,165,0.22)")
POINTS = 4000  # per line: a page of five steps stays below 3 MB
DIGITS = 5  # of the span: residuals are small beside it
USUAL = 0.99  # share of the residuals that the axis shows at least
SHADED = 6  # kinds of regions offered for shading
ROWS = {"yaxis": [0.52, 1.0], "yaxis2": [0.25, 0.46], "yaxis3": [0.0, 0.19]}


def overlay(
    series: Series, settings: LoopSettings, regions: Sequence[Region], noise_floor: float, name: str = "PV predicted"
) -> Figure:
    """Measured and predicted PV, the residual with its worst regions shaded, and OP, on one time axis."""
    lines = [
        line(series, series.setpoint, settings.pv_range, "SP", SETPOINT, width=1.2, dash="dot"),
        line(series, series.measured, settings.pv_range, "PV measured", MEASUREMENT),
        line(series, series.predicted, settings.pv_range, name, PREDICTED),
        line(series, series.residual, _width(settings.pv_range), "residual (measured - predicted)", RESIDUAL, "y2"),
        line(series, series.output, settings.op_range, "OP", OUTPUT, "y3"),
    ]
    lines += _stems(series, settings)
    shaded = [r for r in (fails(regions) or regions) if r.stretches][:SHADED]
    lines += [shading(series, region, place) for place, region in enumerate(shaded)]
    return {"data": lines, "layout": _layout(settings, noise_floor, [series.residual])}


def _stems(series: Series, settings: LoopSettings) -> list[Figure]:
    """Where the stem is as the model sees it, beside OP; none where it follows OP."""
    return [line(series, values, settings.op_range, inside_name(name), STEM, "y3", dash="dash")
            for name, values in series.moved.items()]


def ladder_overlay(series: Series, steps: Sequence[Step], settings: LoopSettings, noise_floor: float) -> Figure:
    """Measured PV with the prediction of each step of the ladder, and what each leaves; buttons choose the step."""
    drawn = [(k, s, s.prediction) for k, s in enumerate(steps) if s.prediction is not None]
    lines = [
        line(series, series.measured, settings.pv_range, "PV measured", MEASUREMENT),
        line(series, series.output, settings.op_range, "OP", OUTPUT, "y3"),
        *_stems(series, settings),
        line(series, series.setpoint, settings.pv_range, "SP", SETPOINT, width=1.2, dash="dot"),
    ]
    always = len(lines)
    last = len(drawn) - 1
    shown = {0, last}
    for place, (k, step, prediction) in enumerate(drawn):
        name = f"{k}: {'baseline' if step.added is None else '+ ' + plain_name(step.added)}"
        colour = STEP_COLOURS[place % len(STEP_COLOURS)]
        rest = np.where(series.used, series.measured - prediction, np.nan)
        pair = [
            line(series, prediction, settings.pv_range, f"{name}, {error_size(step.rmse_holdout)}", colour),
            line(series, rest, _width(settings.pv_range), f"residual {name}", colour, "y2") | {"showlegend": False},
        ]
        lines += [one | {"visible": place in shown, "legendgroup": name} for one in pair]
    rests = [np.where(series.used, series.measured - prediction, np.nan) for _, _, prediction in drawn]
    layout = _layout(settings, noise_floor, rests)
    layout["updatemenus"] = [_buttons(drawn, always)]
    layout["margin"] = {"b": 90}
    return {"data": lines, "layout": layout}


def _buttons(drawn: Sequence[tuple[int, Step, FloatArray]], always: int) -> Figure:
    """One button for the number of each step, and one for all of them; the first `always` lines stay."""
    def button(label: str, wanted: set[int]) -> Figure:
        visible = [*[True] * always, *[place in wanted for place in range(len(drawn)) for _ in range(2)]]
        return {"label": label, "method": "restyle", "args": [{"visible": visible}]}

    # numbers, not names: buttons do not wrap on a narrow screen
    each = [button(str(k), {place}) for place, (k, _, _) in enumerate(drawn)]
    ends = button(f"{drawn[0][0]} + {drawn[-1][0]}", {0, len(drawn) - 1})
    return {"type": "buttons", "direction": "right", "x": 0, "xanchor": "left", "y": -0.12, "yanchor": "top",
            "active": -1, "showactive": True, "bgcolor": "#f2f4f6", "font": {"color": "#1d2733"},
            "buttons": [*each, ends, button("all", set(range(len(drawn))))]}


def ladder_bars(steps: Sequence[Step], noise_floor: float) -> Figure:
    """The hold-out error after each step, from the top down, beside the noise floor."""
    names = [picture("baseline" if s.added is None else f"+ {plain_name(s.added)}") for s in steps]
    errors = [round(100 * s.rmse_holdout, 5) for s in steps]
    floor = 100 * noise_floor
    bars = {"type": "bar", "orientation": "h", "y": [f"{k}  {name}" for k, name in enumerate(names)], "x": errors,
            "text": [error_size(s.rmse_holdout) for s in steps], "textposition": "outside", "cliponaxis": False,
            "textangle": 0, "marker": {"color": [STEP_COLOURS[k % len(STEP_COLOURS)] for k in range(len(steps))]},
            "hovertemplate": "%{y}: %{x:.4g} %<extra></extra>", "showlegend": False, "width": 0.6}
    line_ = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": floor, "x1": floor,
             "line": {"color": MEASUREMENT, "width": 1.5, "dash": "dash"}}
    words = {"xref": "paper", "x": 0, "xanchor": "left", "yref": "paper", "y": 1.0, "yanchor": "bottom",
             "showarrow": False, "text": "on unseen samples; dashed: noise floor"}
    return {"data": [bars], "layout": {
        "xaxis": {"title": {"text": "error [% of PV span]"}, "range": [0, 1.4 * max([*errors, floor])]},
        "yaxis": {"type": "category", "autorange": "reversed"}, "shapes": [line_], "annotations": [words],
        "height": 150 + 48 * len(steps)}}


def plane(series: Series, settings: LoopSettings) -> Figure:
    """PV against OP, measured and predicted: with play or stiction the path is a leaning box."""
    step = max(1, len(series.time) // POINTS)
    lines = []
    both = (("measured", series.measured, MEASUREMENT), ("predicted", series.predicted, PREDICTED))
    for name, values, colour in both:
        kept = np.where(series.used, values, np.nan)[::step]
        lines.append({
            "type": "scatter", "mode": "lines", "name": name, "line": {"color": colour, "width": 1}, "opacity": 0.7,
            "x": units(series.output[::step], settings.op_range, DIGITS), "y": units(kept, settings.pv_range, DIGITS),
            "hovertemplate": "OP %{x}, PV %{y}",
        })
    return {"data": lines, "layout": {"xaxis": {"title": {"text": "OP"}}, "yaxis": {"title": {"text": "PV"}},
                                      "hovermode": "closest", "height": 440}}


def cause_figure(cause: Cause, noise_floor: float) -> Figure:
    """Residual against one thing that it may depend on."""
    lines = []
    models = list(dict.fromkeys(c.model for c in cause.curves))
    kinds = list(dict.fromkeys(c.part for c in cause.curves))
    colours = [PREDICTED] if len(models) == 1 else [QUIET, STEP_COLOURS[2]]
    for curve in cause.curves:
        y = curve.mean if cause.show == "mean" else curve.rms
        stroke = {"color": colours[models.index(curve.model) % 2], "width": 1.6,
                  "dash": ("solid", "dash")[kinds.index(curve.part) % 2]}
        lines.append({
            "type": "scatter", "mode": "lines+markers",
            "name": picture(f"{curve.model}, {curve.part}" if curve.part else curve.model),
            "x": _digits(curve.x), "y": _digits(100 * y), "line": stroke,
            "marker": {"size": 6, "symbol": ("circle", "circle-open")[kinds.index(curve.part) % 2]},
            "hovertemplate": "%{x:.4g}: %{y:.3g} %",
        })
    word = "mean residual" if cause.show == "mean" else "residual (rms)"
    y_title = {"text": f"{word} [% of PV span]"}
    layout: Figure = {"xaxis": {"title": {"text": cause.x_label}}, "yaxis": {"title": y_title}, "hovermode": "closest",
                      "height": 320}
    if cause.show == "spectrum":
        layout["xaxis"]["type"] = "log"
    else:
        layout["shapes"] = [{"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": y, "y1": y,
                             "line": {"color": QUIET, "width": 1, "dash": "dot"}}
                            for y in ([0.0] if cause.show == "mean" else [100 * noise_floor])]
    return {"data": lines, "layout": layout}


def line(series: Series, values: FloatArray, span: tuple[float, float], name: str, colour: str, axis: str = "y", *,
         width: float = 1.4, dash: str = "solid") -> Figure:
    """A signal over time in engineering units; it breaks where it is not known."""
    chosen, _ = thin(np.arange(len(values), dtype=np.int64), values, POINTS)
    return {"type": "scatter", "mode": "lines", "name": picture(name), "yaxis": axis, "connectgaps": False,
            "x": (series.time[chosen] * 1000).astype(np.int64).tolist(), "y": units(values[chosen], span, DIGITS),
            "line": {"color": colour, "width": width, "dash": dash}, "hovertemplate": "%{y}"}


def shading(series: Series, region: Region, place: int) -> Figure:
    """The stretches of a region as one filled line behind the residual, that the legend can switch."""
    x: list[int | None] = []
    y: list[int | None] = []
    for first, last in region.stretches:
        a, b = round(1000 * first), round(1000 * last)
        x += [a, a, b, b, None]
        y += [0, 1, 1, 0, None]
    return {"type": "scatter", "mode": "lines", "name": picture(region.region), "x": x, "y": y, "yaxis": "y4",
            "fill": "tozeroy", "fillcolor": SHADES[place % len(SHADES)], "line": {"width": 0}, "hoverinfo": "skip",
            "visible": True if place == 0 else "legendonly"}


def _layout(settings: LoopSettings, noise_floor: float, rests: Sequence[FloatArray] = ()) -> Figure:
    titles = {"yaxis": "PV", "yaxis2": "residual", "yaxis3": "OP"}
    layout: Figure = {key: {"title": {"text": titles[key]}, "domain": domain} for key, domain in ROWS.items()}
    layout["yaxis4"] = {"overlaying": "y2", "range": [0, 1], "fixedrange": True, "visible": False, "side": "right"}
    layout["xaxis"] = {"type": "date", "anchor": "y3"}
    low, high = settings.pv_range
    band = 2 * noise_floor * (high - low)
    layout["shapes"] = [{"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": "y2", "y0": y, "y1": y,
                         "line": {"color": QUIET, "width": 1, "dash": "dot"}} for y in (-band, band)]
    known = [np.abs(rest[np.isfinite(rest)]) for rest in rests]
    if reach := max((float(np.quantile(r, USUAL)) for r in known if r.size), default=0.0):
        # a model is often far off in its first seconds; the legend's lines go on beyond the axis
        layout["yaxis2"]["range"] = [side * 1.5 * max(reach * (high - low), band) for side in (-1.0, 1.0)]
    return layout | {"hovermode": "x", "height": 640}


def _width(span: tuple[float, float]) -> tuple[float, float]:
    """The span of a difference: it has the scale of the range, not its zero."""
    return 0.0, span[1] - span[0]


def _digits(values: FloatArray) -> list[float]:
    return [float(f"{v:.5g}") for v in values.tolist()]
