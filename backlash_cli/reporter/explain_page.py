"""How an explanation was found, as a page: the ladder as a picture, each step over the measurement."""

from __future__ import annotations

from ..results import Candidate, Explanation
from . import explain_figures as figures
from .compare_page import depends_on, effect_sections, error, parameter_table, where
from .explain_words import (
    candidate_verdict,
    ladder,
    look_alike_words,
    plain_name,
    rest_words,
    share,
    span_words,
    verdict,
)
from .loop_page import note_table
from .page import Cell, Section, Table, page
from .parameter_words import numbers


def explain_page(e: Explanation, *, plotly_file: str = "", back: tuple[str, str] | None = None) -> str:
    """Return the page of an explanation; plotly_file and back as in `page`, for a folder of many pages."""
    text = [verdict(e), *[n.message for n in e.reasons], *look_alike_words(e)]
    text += [rest_words(e)] if e.adequate else []
    if e.unexplained is not None:
        text.append(f"Of the squared error above the noise, {share(e.unexplained)} stays unexplained.")
    sections = [Section("The answer", text=text, figure=figures.ladder_bars(e.steps, e.noise_floor),
                        note=ladder(e.steps, e.noise_floor), anchor="answer")]
    if e.series is not None and any(s.prediction is not None for s in e.steps):
        sections.append(Section(
            "Each step over the measurement", anchor="steps",
            figure=figures.ladder_overlay(e.series, e.steps, e.settings, e.noise_floor),
            note="The buttons choose steps by their number in the ladder, the legend switches single lines. Drag to "
                 "zoom, double-click to return. Dotted: twice the measurement noise.",
        ))
    sections += effect_sections(e.effects, e.settings, e.series)
    sections += [_candidates(e)] if e.candidates else []
    sections += [where(e.where, "Where the final model fails")] if e.where else []
    if e.where_before and e.effects:
        sections.append(where(e.where_before, "Where the plain model failed", "where-before", folded=True))
    if e.series is not None:
        first, last = e.steps[0].prediction if e.steps else None, e.series.predicted
        lines = {"plain model": first, "final model": last} if first is not None and e.effects else {"model": last}
        sections.append(depends_on(e.series, {k: v for k, v in lines.items() if v is not None}, e.noise_floor))
    sections.append(Section("First-order part", table=parameter_table((e.final or e.baseline).parameters)))
    sections += [Section("Warnings", table=note_table(e.warnings), anchor="warnings")] if e.warnings else []
    return page(f"{e.loop}: which effect is missing?", sections, subtitle=span_words(e), plotly_file=plotly_file,
                back=back)


def _candidates(e: Explanation) -> Section:
    start = None if e.series is None else float(e.series.time[0])

    def row(c: Candidate) -> list[object]:
        said = ", ".join(f"{name} = {text}" for name, text in numbers(c, e.settings, start).items())
        return [Cell(plain_name(c.effect), mark="good" if c.verdict == "accepted" else ""), error(c.rmse_holdout),
                Cell(c.error_reduction, text=share(c.error_reduction)),
                None if c.evidence is None else Cell(c.evidence, text=f"{c.evidence:.0f}"),
                candidate_verdict(e, c) or None, said]

    columns = ["Effect", "Hold-out error", "Error gone", "Evidence", "Verdict", "Numbers when alone"]
    return Section("Each effect tried alone", table=Table(columns, [row(c) for c in e.candidates]), anchor="candidates",
                   note="Error gone: share of the squared hold-out error of the plain model. Evidence: how much more "
                        "likely the record is with the effect, after its parameters are paid for; from 20 on it is "
                        "taken, if it predicts better, too.")
