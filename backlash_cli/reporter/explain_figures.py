"""Interactive figures of the workbench, as plain plotly dicts in engineering units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..record import FloatArray, LoopSettings
from ..results import Region, Series, Step
from .figures import (
    EVIDENCE,
    GREEN,
    MEASUREMENT,
    OUTPUT,
    QUIET,
    SETPOINT,
    STEM,
    Figure,
    across,
    axis,
    ms,
    over_time,
    trace,
    units,
    written,
)
from .residual_causes import Cause
from .safe import picture
from .words import error_size, fails, inside_name, rung

PREDICTED, RESIDUAL = EVIDENCE, "#7a5bc7"
STEP_COLOURS = (QUIET, EVIDENCE, GREEN, "#7a5bc7", "#b8578f", "#5a6b00")
SHADES = ("rgba(209,52,91,0.18)", "rgba(199,119,0,0.18)", "rgba(42,157,92,0.18)", "rgba(122,91,199,0.18)",
          "rgba(11,138,158,0.18)", "rgba(141,153,165,0.22)")
POINTS = 4000  # per line: a page of five steps stays below 3 MB
DIGITS = 5  # of the span: residuals are small beside it
USUAL = 0.99  # share of the residuals that the axis shows at least
SHADED = 6  # kinds of regions offered for shading


def overlay(
    series: Series, settings: LoopSettings, regions: Sequence[Region], noise_floor: float, name: str = "PV predicted"
) -> Figure:
    """Measured and predicted PV, the residual with its worst regions shaded, and OP, on one time axis."""
    setpoint, measured, *below = _recorded(series, settings)
    lines = [setpoint, measured, _line(series, series.predicted, settings.pv_range, name, PREDICTED),
             _line(series, series.residual, _width(settings.pv_range), "residual (measured - predicted)", RESIDUAL,
                   yaxis="y2"), *below]
    shaded = [r for r in (fails(regions) or regions) if r.stretches][:SHADED]
    lines += [_shading(region, place) for place, region in enumerate(shaded)]
    return {"data": lines, "layout": _layout(settings, noise_floor, [series.residual])}


def _recorded(series: Series, settings: LoopSettings) -> list[Figure]:
    """SP, PV and OP, and where the stem is as the model sees it where it does not follow OP."""
    return [_line(series, series.setpoint, settings.pv_range, "SP", SETPOINT, width=1.2, dash="dot"),
            _line(series, series.measured, settings.pv_range, "PV measured", MEASUREMENT),
            _line(series, series.output, settings.op_range, "OP", OUTPUT, yaxis="y3"),
            *(_line(series, values, settings.op_range, inside_name(name), STEM, yaxis="y3", dash="dash")
              for name, values in series.moved.items())]


def ladder_overlay(series: Series, steps: Sequence[Step], settings: LoopSettings, noise_floor: float) -> Figure:
    """Measured PV with the prediction of each step of the ladder, and what each leaves; buttons choose the step."""
    drawn = [(k, s, s.prediction) for k, s in enumerate(steps) if s.prediction is not None]
    setpoint, *recorded = _recorded(series, settings)
    always = [*recorded, setpoint]
    lines, rests = list(always), []
    for place, (k, step, prediction) in enumerate(drawn):
        name, colour = f"{k}: {rung(step)}", STEP_COLOURS[place % len(STEP_COLOURS)]
        rests.append(np.where(series.used, series.measured - prediction, np.nan))
        switched: Figure = {"visible": place in (0, len(drawn) - 1), "legendgroup": name}
        lines += [_line(series, prediction, settings.pv_range, f"{name}, {error_size(step.rmse_holdout)}", colour,
                        **switched),
                  _line(series, rests[-1], _width(settings.pv_range), f"residual {name}", colour, yaxis="y2",
                        showlegend=False, **switched)]

    def button(label: str, wanted: set[int]) -> Figure:
        visible = [*[True] * len(always), *[place in wanted for place in range(len(drawn)) for _ in range(2)]]
        return {"label": label, "method": "restyle", "args": [{"visible": visible}]}

    # numbers, not names: buttons do not wrap on a narrow screen
    buttons = [*(button(str(k), {place}) for place, (k, _, _) in enumerate(drawn)),
               button(f"{drawn[0][0]} + {drawn[-1][0]}", {0, len(drawn) - 1}), button("all", set(range(len(drawn))))]
    layout = _layout(settings, noise_floor, rests)
    layout["margin"] = {"b": 90}
    layout["updatemenus"] = [{
        "type": "buttons", "direction": "right", "x": 0, "xanchor": "left", "y": -0.12, "yanchor": "top", "active": -1,
        "showactive": True, "bgcolor": "#f2f4f6", "font": {"color": "#1d2733"}, "buttons": buttons}]
    return {"data": lines, "layout": layout}


def ladder_bars(steps: Sequence[Step], noise_floor: float) -> Figure:
    """The hold-out error after each step, from the top down, beside the noise floor."""
    errors, floor = [round(100 * s.rmse_holdout, 5) for s in steps], 100 * noise_floor
    bars = {"type": "bar", "orientation": "h", "y": [f"{k}  {picture(rung(s))}" for k, s in enumerate(steps)],
            "x": errors, "text": [error_size(s.rmse_holdout) for s in steps], "textposition": "outside",
            "cliponaxis": False, "textangle": 0, "hovertemplate": "%{y}: %{x:.4g} %<extra></extra>",
            "showlegend": False, "width": 0.6,
            "marker": {"color": [STEP_COLOURS[k % len(STEP_COLOURS)] for k in range(len(steps))]}}
    words = written("on unseen samples; dashed: noise floor", 0, 1.0, xref="paper", xanchor="left", yref="paper",
                    yanchor="bottom")
    return {"data": [bars], "layout": {
        "xaxis": axis("error [% of PV span]", range=[0, 1.4 * max([*errors, floor])]),
        "yaxis": {"type": "category", "autorange": "reversed"}, "annotations": [words], "height": 150 + 48 * len(steps),
        "shapes": [across("x", floor, MEASUREMENT, width=1.5, dash="dash")]}}


def plane(series: Series, settings: LoopSettings) -> Figure:
    """PV against OP, measured and predicted: with play or stiction the path is a leaning box."""
    every = slice(None, None, max(1, len(series.time) // POINTS))
    op = units(series.output[every], settings.op_range, DIGITS)
    lines = [trace(op, units(np.where(series.used, values, np.nan)[every], settings.pv_range, DIGITS), name, colour,
                   width=1, opacity=0.7, hover="OP %{x}, PV %{y}")
             for name, values, colour in (("measured", series.measured, MEASUREMENT),
                                          ("predicted", series.predicted, PREDICTED))]
    return {"data": lines, "layout": {"xaxis": axis("OP"), "yaxis": axis("PV"), "hovermode": "closest", "height": 440}}


def cause_figure(cause: Cause, noise_floor: float) -> Figure:
    """Residual against one thing that it may depend on."""
    models = list(dict.fromkeys(c.model for c in cause.curves))
    kinds = list(dict.fromkeys(c.part for c in cause.curves))
    colours = [PREDICTED] if len(models) == 1 else [QUIET, STEP_COLOURS[2]]
    lines = []
    for curve in cause.curves:
        y, kind = curve.mean if cause.show == "mean" else curve.rms, kinds.index(curve.part) % 2
        lines.append(trace(_digits(curve.x), _digits(100 * y),
                           f"{curve.model}, {curve.part}" if curve.part else curve.model,
                           colours[models.index(curve.model) % 2], mode="lines+markers", width=1.6,
                           dash=("solid", "dash")[kind], size=6, symbol=("circle", "circle-open")[kind],
                           hover="%{x:.4g}: %{y:.3g} %"))
    word = "mean residual" if cause.show == "mean" else "residual (rms)"
    layout: Figure = {"xaxis": axis(cause.x_label), "yaxis": axis(f"{word} [% of PV span]"), "hovermode": "closest",
                      "height": 320}
    if cause.show == "spectrum":
        layout["xaxis"]["type"] = "log"
    else:
        layout["shapes"] = [across("y", 0.0 if cause.show == "mean" else 100 * noise_floor, QUIET, dash="dot")]
    return {"data": lines, "layout": layout}


def _line(series: Series, values: FloatArray, span: tuple[float, float], name: str, colour: str, *, width: float = 1.4,
          **more: Any) -> Figure:
    return over_time(series.time, values, span, name, colour, points=POINTS, digits=DIGITS, width=width,
                     connectgaps=False, **more)


def _shading(region: Region, place: int) -> Figure:
    """The stretches of a region as one filled line behind the residual, that the legend can switch."""
    ends = [(ms(first), ms(last)) for first, last in region.stretches]
    return trace([x for a, b in ends for x in (a, a, b, b, None)], [0, 1, 1, 0, None] * len(ends), region.region, QUIET,
                 width=0, hover="", hoverinfo="skip", yaxis="y4", fill="tozeroy", fillcolor=SHADES[place % len(SHADES)],
                 visible=True if place == 0 else "legendonly")


def _layout(settings: LoopSettings, noise_floor: float, rests: Sequence[FloatArray] = ()) -> Figure:
    low, high = settings.pv_range
    band = 2 * noise_floor * (high - low)
    residual = axis("residual", domain=[0.25, 0.46])
    known = [np.abs(rest[np.isfinite(rest)]) for rest in rests]
    if reach := max((float(np.quantile(r, USUAL)) for r in known if r.size), default=0.0):
        # a model is often far off in its first seconds; the legend's lines go on beyond the axis
        residual["range"] = [side * 1.5 * max(reach * (high - low), band) for side in (-1.0, 1.0)]
    return {"xaxis": {"type": "date", "anchor": "y3"}, "yaxis": axis("PV", domain=[0.52, 1.0]), "yaxis2": residual,
            "yaxis3": axis("OP", domain=[0.0, 0.19]), "hovermode": "x", "height": 640,
            "yaxis4": {"overlaying": "y2", "range": [0, 1], "fixedrange": True, "visible": False, "side": "right"},
            "shapes": [across("y", y, QUIET, dash="dot", yref="y2") for y in (-band, band)]}


def _width(span: tuple[float, float]) -> tuple[float, float]:
    """The span of a difference: it has the scale of the range, not its zero."""
    return 0.0, span[1] - span[0]


def _digits(values: FloatArray) -> list[float]:
    return [float(f"{v:.5g}") for v in values.tolist()]
