"""One model against one record, as a page: how far off, where, and what the error depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..record import FloatArray, LoopSettings
from ..results import Comparison, FittedEffect, FittedParameter, Region, Series
from . import explain_figures as figures
from .explain_words import error_size, fails, plain_name, predicted_name, share, span_words, still_holds, sureness
from .loop_page import note_table
from .page import Cell, Section, Table, page
from .parameter_words import meaning, numbers, quantity
from .residual_causes import causes

REGIONS = 8  # in the table of where a model fails; all are in the folded one


def compare_page(c: Comparison) -> str:
    """Return the page of a comparison."""
    rows: list[list[object]] = [
        [name, error(f.rmse), error(f.rmse_holdout)]
        for name, f in ([] if c.fitted else [("this model", c.fitness)]) + [("plain model", c.baseline)]
    ]
    rows.append(["noise floor", error(c.noise_floor), None])
    text = [] if not still_holds(c) else [
        still_holds(c),
        *(f"Why: {note.message}." for note in c.reasons),
        "The numbers of the model file were kept; only what belongs to this record (offset, start) was matched.",
    ]
    if c.unexplained is not None:
        text.append(f"Of the squared error above the noise, this model leaves {share(c.unexplained)} unexplained.")
    sections = [Section("How well it fits", text=text, table=Table(["Model", "Fit", "Hold-out"], rows, sortable=False),
                        anchor="fit",
                        note="Root mean square error in % of the PV span. Hold-out: on samples the fit did not see. "
                             "No model can do better than the measurement noise.")]
    if c.series is not None:
        sections.append(Section(
            "Measured and predicted",
            figure=figures.overlay(c.series, c.settings, c.where, c.noise_floor, predicted_name(c)), anchor="trend",
            note="Drag to zoom, double-click to return; one time axis for all. Shaded: regions where the model fails, "
                 "chosen in the legend. Dotted: twice the measurement noise.",
        ))
    sections += [where(c.where)] if c.where else []
    sections += effect_sections(c.effects, c.settings, c.series)
    if c.series is not None:
        sections.append(Section("PV against OP", figure=figures.plane(c.series, c.settings), anchor="plane",
                                note="Play and stiction make a leaning box; a curved valve bends the path."))
        sections.append(depends_on(c.series, {"this model": c.series.predicted}, c.noise_floor))
    sections.append(Section("First-order part", table=parameter_table(c.fitness.parameters or c.baseline.parameters),
                            anchor="parameters"))
    sections += [Section("Warnings", table=note_table(c.warnings), anchor="warnings")] if c.warnings else []
    return page(f"{c.loop}: model against measurement", sections, subtitle=span_words(c))


def error(value: float) -> Cell:
    """An error as a cell that sorts by size."""
    return Cell(value, text=error_size(value))


def where(
    regions: Sequence[Region], title: str = "Where the model fails", anchor: str = "where", *, folded: bool = False
) -> Section:
    """The table of regions where the model fails, worst first, and folded below it all of them."""
    worse = fails(regions)[:REGIONS]
    note = ("Regions overlap, so the shares do not add up to 100 %. The model fails where the share of the error is "
            "much larger than the share of the time.")
    rest = Section("All parts of the record", table=_regions(regions), folded=True)
    if not worse:
        return Section(title, text=["Nowhere in particular: the error is spread evenly over the record."], parts=[rest],
                       anchor=anchor, folded=folded, note=note)
    return Section(title, table=_regions(worse), anchor=anchor, folded=folded, note=note,
                   parts=[rest] if len(worse) < len(regions) else [])


def _regions(regions: Sequence[Region]) -> Table:
    rows = [[r.region, error(r.rmse), Cell(r.share, text=share(r.share)), Cell(r.expected, text=share(r.expected)),
             r.sentence] for r in regions]
    return Table(["Where", "Error", "Of the error", "Of the time", "In words"], rows)


def effect_sections(effects: Sequence[FittedEffect], settings: LoopSettings, series: Series | None) -> list[Section]:
    """One part per effect: what it means in the plant, and its numbers."""
    if not effects:
        return []
    start = None if series is None else float(series.time[0])
    parts = [
        Section(plain_name(e.effect).capitalize(),
                text=[meaning(e, settings, start), *filter(None, [sureness(e)]),
                      *(f"Take care: {note.message}." for note in e.notes)],
                table=_events(e, settings, start) or Table(
                    ["Parameter", "What it is", "Value"],
                    [[name, e.parameters[name].meaning if name in e.parameters else "measured column", said]
                     for name, said in numbers(e, settings, start).items()], sortable=False))
        for e in effects
    ]
    return [Section("What it means in the plant", parts=parts, anchor="effects")]


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


def depends_on(series: Series, predictions: Mapping[str, FloatArray], noise_floor: float) -> Section:
    """The residual against each of its candidate causes."""
    parts = [
        Section(cause.title, figure=figures.cause_figure(cause, noise_floor), note=cause.note)
        for cause in causes(series, figures.with_residuals(series, predictions))
    ]
    return Section("What the error depends on", parts=parts, anchor="causes",
                   text=["Each kind of missing effect leaves its own mark. A line that stays level says: not this."])


def parameter_table(parameters: Mapping[str, FittedParameter]) -> Table:
    """Gain, time constant, dead time and offset with their intervals."""
    words = {"Kp": "static gain", "tau": "time constant", "theta": "dead time", "offset": "offset"}
    return Table(["Parameter", "What it is", "Value"], [
        [name, p.meaning or words.get(name, ""), quantity(p, "process", LoopSettings())]
        for name, p in parameters.items() if not p.nuisance
    ], sortable=False)
