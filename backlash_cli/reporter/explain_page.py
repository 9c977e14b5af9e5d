"""Pages and still pictures of the workbench: one model against one record, and how an explanation was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import UsageError
from ..record import FloatArray, LoopSettings
from ..results import Candidate, Comparison, Explanation, FittedEffect, FittedParameter, Region, Series
from . import explain_figures as figures
from .explain_words import (
    candidate_verdict,
    effect_words,
    error_size,
    fails,
    ladder,
    look_alike_words,
    plain_name,
    predicted_name,
    rest_words,
    share,
    span_words,
    still_holds,
    unexplained_words,
    verdict,
)
from .figures import Figure
from .loop_page import note_table
from .page import Cell, Section, Table, page
from .parameter_words import numbers, quantity, said_numbers
from .residual_causes import causes
from .still import still, write_still

REGIONS = 8  # in the table of where a model fails; all are in the folded one
DPI = 80


def compare_page(c: Comparison) -> str:
    """Return the page of a comparison."""
    models = [*([] if c.fitted else [("this model", c.fitness)]), ("plain model", c.baseline)]
    rows: list[list[object]] = [*([name, _error(f.rmse), _error(f.rmse_holdout)] for name, f in models),
                                ["noise floor", _error(c.noise_floor), None]]
    text = [] if not still_holds(c) else [
        still_holds(c), *(f"Why: {note.message}." for note in c.reasons),
        "The numbers of the model file were kept; only what belongs to this record (offset, start) was matched.",
    ]
    sections = [Section(
        "How well it fits", text=[*text, *filter(None, [unexplained_words(c)])], anchor="fit",
        table=Table(["Model", "Fit", "Hold-out"], rows, sortable=False),
        note="Root mean square error in % of the PV span. Hold-out: on samples the fit did not see. No model can do "
             "better than the measurement noise.",
    )]
    if c.series is not None:
        sections.append(Section(
            "Measured and predicted", anchor="trend",
            figure=figures.overlay(c.series, c.settings, c.where, c.noise_floor, predicted_name(c)),
            note="Drag to zoom, double-click to return; one time axis for all. Shaded: regions where the model fails, "
                 "chosen in the legend. Dotted: twice the measurement noise.",
        ))
    sections += [*_where(c.where, "Where the model fails", "where"), *_effects(c.effects, c.settings, c.series)]
    if c.series is not None:
        sections.append(Section("PV against OP", figure=figures.plane(c.series, c.settings), anchor="plane",
                                note="Play and stiction make a leaning box; a curved valve bends the path."))
        sections.append(_depends_on(c.series, {"this model": c.series.predicted}, c.noise_floor))
    sections += _closing(c, c.fitness.parameters or c.baseline.parameters)
    return page(f"{c.loop}: model against measurement", sections, subtitle=span_words(c))


def explain_page(e: Explanation, *, plotly_file: str = "", back: tuple[str, str] | None = None) -> str:
    """Return the page of an explanation; plotly_file and back as in `page`, for a folder of many pages."""
    text = [verdict(e), *[n.message for n in e.reasons], *look_alike_words(e), rest_words(e) if e.adequate else "",
            unexplained_words(e)]
    sections = [Section("The answer", text=[*filter(None, text)], figure=figures.ladder_bars(e.steps, e.noise_floor),
                        note=ladder(e.steps, e.noise_floor), anchor="answer")]
    if e.series is not None and any(s.prediction is not None for s in e.steps):
        sections.append(Section(
            "Each step over the measurement", anchor="steps",
            figure=figures.ladder_overlay(e.series, e.steps, e.settings, e.noise_floor),
            note="The buttons choose steps by their number in the ladder, the legend switches single lines. Drag to "
                 "zoom, double-click to return. Dotted: twice the measurement noise.",
        ))
    sections += _effects(e.effects, e.settings, e.series)
    sections += [_candidates(e)] if e.candidates else []
    sections += _where(e.where, "Where the final model fails", "where")
    if e.effects:
        sections += _where(e.where_before, "Where the plain model failed", "where-before", folded=True)
    if e.series is not None:
        first, last = e.steps[0].prediction if e.steps else None, e.series.predicted
        lines = {"plain model": first, "final model": last} if first is not None and e.effects else {"model": last}
        sections.append(_depends_on(e.series, {k: v for k, v in lines.items() if v is not None}, e.noise_floor))
    sections += _closing(e, (e.final or e.baseline).parameters)
    return page(f"{e.loop}: which effect is missing?", sections, subtitle=span_words(e), plotly_file=plotly_file,
                back=back)


def _error(value: float) -> Cell:
    return Cell(value, text=error_size(value))


def _candidates(e: Explanation) -> Section:
    start = None if e.series is None else float(e.series.time[0])

    def row(c: Candidate) -> list[object]:
        return [Cell(plain_name(c.effect), mark="good" if c.verdict == "accepted" else ""), _error(c.rmse_holdout),
                Cell(c.error_reduction, text=share(c.error_reduction)),
                None if c.evidence is None else Cell(c.evidence, text=f"{c.evidence:.0f}"),
                candidate_verdict(e, c) or None, said_numbers(c, e.settings, start)]

    columns = ["Effect", "Hold-out error", "Error gone", "Evidence", "Verdict", "Numbers when alone"]
    return Section("Each effect tried alone", table=Table(columns, [row(c) for c in e.candidates]), anchor="candidates",
                   note="Error gone: share of the squared hold-out error of the plain model. Evidence: how much more "
                        "likely the record is with the effect, after its parameters are paid for; from 20 on it is "
                        "taken, if it predicts better, too.")


def _where(regions: Sequence[Region], title: str, anchor: str, *, folded: bool = False) -> list[Section]:
    """The table of regions where the model fails, worst first, and folded below it all of them."""
    if not regions:
        return []
    worse = fails(regions)[:REGIONS]
    rest = Section("All parts of the record", table=_regions(regions), folded=True)
    return [Section(
        title, text=[] if worse else ["Nowhere in particular: the error is spread evenly over the record."],
        table=_regions(worse) if worse else None, parts=[rest] if len(worse) < len(regions) else [], anchor=anchor,
        folded=folded, note="Regions overlap, so the shares do not add up to 100 %. The model fails where the share of "
                            "the error is much larger than the share of the time.",
    )]


def _regions(regions: Sequence[Region]) -> Table:
    rows = [[r.region, _error(r.rmse), Cell(r.share, text=share(r.share)), Cell(r.expected, text=share(r.expected)),
             r.sentence] for r in regions]
    return Table(["Where", "Error", "Of the error", "Of the time", "In words"], rows)


def _effects(effects: Sequence[FittedEffect], settings: LoopSettings, series: Series | None) -> list[Section]:
    """One part per effect: what it means in the plant, and its numbers."""
    start = None if series is None else float(series.time[0])
    parts = [
        Section(plain_name(e.effect).capitalize(), text=effect_words(e, settings, start),
                table=_events(e, settings, start) or Table(
                    ["Parameter", "What it is", "Value"],
                    [[name, e.parameters[name].meaning if name in e.parameters else "measured column", said]
                     for name, said in numbers(e, settings, start).items()], sortable=False))
        for e in effects
    ]
    return [Section("What it means in the plant", parts=parts, anchor="effects")] if parts else []


def _events(effect: FittedEffect, settings: LoopSettings, start: float | None) -> Table | None:
    """An effect of several events as a table, one event in a row; None for any other."""
    lists = {n: p for n, p in effect.parameters.items() if isinstance(p.value, tuple) and not p.nuisance}
    counts = {len(p.value) for p in lists.values() if isinstance(p.value, tuple)}
    if len(lists) < 2 or len(counts) != 1:
        return None

    def one(p: FittedParameter, i: int) -> str:
        assert isinstance(p.value, tuple)
        own = None if p.ci95 is None else (p.ci95[i],)
        only = replace(p, value=(p.value[i],), ci95=own)  # type: ignore[arg-type]
        return quantity(only, effect.stage, settings, start)

    return Table(list(lists), [[one(p, i) for p in lists.values()] for i in range(counts.pop())], sortable=False)


def _depends_on(series: Series, predictions: Mapping[str, FloatArray], noise_floor: float) -> Section:
    """The residual against each of its candidate causes."""
    rests = {name: np.where(series.used, series.measured - p, np.nan) for name, p in predictions.items()}
    parts = [Section(cause.title, figure=figures.cause_figure(cause, noise_floor), note=cause.note)
             for cause in causes(series, rests)]
    return Section("What the error depends on", parts=parts, anchor="causes",
                   text=["Each kind of missing effect leaves its own mark. A line that stays level says: not this."])


def _closing(found: Comparison | Explanation, parameters: Mapping[str, FittedParameter]) -> list[Section]:
    """Gain, time constant, dead time and offset with their intervals, and warnings."""
    words = {"Kp": "static gain", "tau": "time constant", "theta": "dead time", "offset": "offset"}
    table = Table(["Parameter", "What it is", "Value"], [
        [name, p.meaning or words.get(name, ""), quantity(p, "process", LoopSettings())]
        for name, p in parameters.items() if not p.nuisance
    ], sortable=False)
    warnings = [Section("Warnings", table=note_table(found.warnings), anchor="warnings")] if found.warnings else []
    return [Section("First-order part", table=table, anchor="parameters"), *warnings]


def check_picture(path: Path | None) -> None:
    """Refuse a name that no picture can have. Raises UsageError."""
    if path is not None and path.suffix.lower() not in (".png", ".svg"):
        raise UsageError("a picture is .png or .svg", where=str(path), remedy=f"name it {path.stem}.png")


def write_picture(found: Comparison | Explanation, path: Path) -> None:
    """Draw the result to `path`, whole or not at all. Raises UsageError for another suffix, or without a record."""
    check_picture(path)
    if (series := found.series) is None:
        raise UsageError("the result keeps no samples to draw", where=str(path))
    floor = found.noise_floor
    if isinstance(found, Comparison):
        title = f"{found.loop}: model against measurement, hold-out error {error_size(found.fitness.rmse_holdout)}"
        lines = figures.overlay(series, found.settings, found.where, floor, predicted_name(found))
        beside = ("PV against OP", figures.plane(series, found.settings))
        rests = {"this model": series.residual}
    else:
        title = f"{found.loop}: which effect is missing?"
        lines = figures.ladder_overlay(series, found.steps, found.settings, floor)
        beside = ("", figures.ladder_bars(found.steps, floor))
        ends = zip(("before", "after"), found.steps[:1] + found.steps[1:][-1:], strict=False)
        rests = {word: np.where(series.used, series.measured - step.prediction, np.nan)
                 for word, step in ends if step.prediction is not None}
    rows = [[beside, *_turns(series, rests, floor)], [("", lines)]]
    write_still(path, still(title, rows, (1.0, 2.2), (9.5, 8.5)), DPI)


def _turns(series: Series, residuals: dict[str, FloatArray], noise_floor: float) -> list[tuple[str, Figure]]:
    """Mean residual against the time since OP turned, the mark of play and stiction."""
    found = causes(series, residuals)[:1] if residuals else []
    return [(cause.title, figures.cause_figure(cause, noise_floor)) for cause in found]
