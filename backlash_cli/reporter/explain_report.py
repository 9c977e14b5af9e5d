"""Comparison, explanation and the summary of a plant: which effect is missing where, and why not elsewhere."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..errors import UsageError
from ..record import Frozen, Note
from ..results import Comparison, Explanation, PlantExplanation
from ..words import WORDS
from . import explain_figures as figures
from . import json_report
from .figures import axis, figure
from .report import Report
from .safe import counted, entitled
from .still import still, write_still
from .tables import csv_table
from .templates import sentence
from .words import error_size, plain_name, rung, said_numbers, several

DPI = 80
SILENT = ("too_little_motion", "not_explained")
COLUMNS = tuple(WORDS["rows"]["effects"])


def judged(found: Comparison | Explanation) -> Report:
    """Return how well a model fits, what is the best to hope for, and where it fails; or the ladder of an explanation,
    the answer, what each effect means in the plant, and what stays unexplained."""
    name, key, question = ("compare", "c", "model against measurement") if isinstance(found, Comparison) else (
        "explain", "e", "which effect is missing?")
    return Report(name, f"{found.loop}: {question}", {key: found}, lambda: json_report.judged(found),
                  lambda: _drawn(found), sentence("span", found))


def _drawn(found: Comparison | Explanation) -> dict[str, Any]:
    """Model over measurement, what is beside it, and what the residual depends on; None without a record."""
    series, floor = found.series, found.noise_floor
    drawn: dict[str, Any] = dict.fromkeys(("overlay", "beside", "causes"))
    if isinstance(found, Explanation):
        drawn["beside"], steps = figures.ladder_bars(found.steps, floor), found.steps
    if series is None:
        return drawn
    if isinstance(found, Comparison):
        drawn["beside"] = figures.plane(series, found.settings)
        shown, regions = {sentence("predicted", found): series.predicted}, found.where
        models = {"this model": series.predicted}
    else:
        first, last = steps[0].prediction if steps and found.effects else None, series.predicted
        shown, regions = {f"{k}: {rung(s)}, {error_size(s.rmse_holdout)}": s.prediction for k, s in enumerate(steps)
                          if s.prediction is not None}, ()
        models = {"model": last} if first is None else {"plain model": first, "final model": last}
    if shown:
        drawn["overlay"] = figures.overlay(series, shown, found.settings, floor, regions)
    return drawn | {"causes": figures.causes(series, models, floor)}


def check_picture(path: Path | None) -> None:
    """Refuse a name that no picture can have. Raises UsageError."""
    if path is not None and path.suffix.lower() not in (".png", ".svg"):
        raise UsageError("a picture is .png or .svg", where=str(path), remedy=f"name it {path.stem}.png")


def write_picture(found: Comparison | Explanation, path: Path) -> None:
    """Draw the result to `path`, whole or not at all. Raises UsageError for another suffix, or without a record."""
    check_picture(path)
    if found.series is None:
        raise UsageError("the result keeps no samples to draw", where=str(path))
    title, words, drawn = judged(found).title, "", _drawn(found)
    if isinstance(found, Explanation):
        title = f"{found.loop}: {sentence('verdict', found).partition('. ')[0].rstrip('.')}"
    else:
        title, words = f"{title}, hold-out error {error_size(found.fitness.rmse_holdout)}", "PV against OP"
    # mean residual against the time since OP turned, the mark of play and stiction
    turns = [(cause, figure) for cause, _, figure in drawn["causes"][:1]]
    write_still(path, still(title, [[(words, drawn["beside"]), *turns], [("", drawn["overlay"])]], (1.0, 2.2),
                            (9.5, 8.5)), DPI)


class Tally(Frozen):
    """One effect, or several counted together: in which loops it was accepted, where it is small, and why not else."""

    name: str
    loops: tuple[str, ...]
    small: tuple[str, ...]
    why: dict[str, int]  # code -> number of the other loops, the most frequent first

    @property
    def words(self) -> str:
        """The reasons; those of whole loops are told once (`silent` of the sentences)."""
        return "; ".join(f"{sentence('why', code)} ({k})" for code, k in self.why.items() if code not in SILENT)


def tallies(plant: PlantExplanation) -> list[Tally]:
    """Return all gaps in the valve together, then each effect that was tried, most accepted first."""
    def tally(*names: str) -> Tally:
        have = {x.loop: [e.notes for e in x.effects if e.effect in names] for x in plant.loops}
        why = Counter(reason(x, names).code for x in plant.loops if not have[x.loop])
        why += Counter(not_explained=len(plant.failures))
        return Tally(" or ".join(map(plain_name, sorted(names))), tuple(loop for loop in have if have[loop]),
                     tuple(loop for loop, notes in have.items() if any(notes)), dict(why.most_common()))

    tried = [one for x in plant.loops for one in (*x.effects, *x.candidates)]
    gaps = {one.effect for one in tried if one.gap is not None}
    single = [tally(name) for name in dict.fromkeys(one.effect for one in tried)]
    return [tally(*gaps)] * (len(gaps) > 1) + sorted(single, key=lambda t: -len(t.loops))


def reason(x: Explanation, names: Iterable[str]) -> Note:
    """Return why none of these effects was accepted: of the whole loop, or of the likeliest of those tried."""
    tried = [c for c in x.candidates if c.effect in names and c.why is not None]
    tried.sort(key=lambda c: float("inf") if c.evidence is None else -c.evidence)
    silent = [note for note in x.reasons if note.code in SILENT]
    return [*silent, *(c.why for c in tried if c.why), Note("not_tried", sentence("why", "not_tried"))][0]


def to_csv(plant: PlantExplanation) -> str:
    """Return one row per loop as CSV, those that could not be explained last; errors in parts of the PV span."""
    lost = [{"loop": n.values.get("loop", n.values.get("file", "")), "failure": n.message} for n in plant.failures]
    return csv_table(COLUMNS, (*map(_row, plant.loops), *lost))


def _row(x: Explanation) -> dict[str, Any]:
    before, after = x.baseline.rmse_holdout, x.rmse_holdout
    no_gap = None if any(e.gap is not None for e in x.effects) else reason(
        x, [c.effect for c in x.candidates if c.gap is not None])
    return {"loop": x.loop, "missing_effect": x.missing_effect, "effects": "; ".join(e.effect for e in x.effects),
        "numbers": _numbers(x, brief=False), "rmse_baseline": before, "rmse_final": after, "noise_floor": x.noise_floor,
        "error_reduction": 1.0 - (after / before) ** 2 if before > 0 else None, "unexplained": x.unexplained,
        "look_alikes": "; ".join(" = ".join(pair) for pair in x.look_alikes), "verdict": sentence("verdict", x),
        "gap_small": "; ".join(n.message for e in x.effects for n in e.notes), "no_gap": no_gap and no_gap.code,
        "no_gap_because": no_gap and no_gap.message, "warnings": "; ".join(n.code for n in x.warnings)}


def _numbers(x: Explanation, *, brief: bool = True) -> str:
    start = x.model.start if x.model is not None else None
    said = ((brief and several(e, x.settings)) or said_numbers(e, x.settings, start, brief=brief) for e in x.effects)
    return "; ".join(f"{plain_name(e.effect)} {words}{' (small)' * bool(e.notes)}"
                     for e, words in zip(x.effects, said, strict=True))


def summary(plant: PlantExplanation) -> Report:
    """Return which effects are missing in how many loops, why each is not in the others, and which gaps are small; the
    page takes `links`, the addresses of the loops' own pages."""
    told, found = tallies(plant), dict(Counter(e.effect for x in plant.loops for e in x.effects).most_common())
    found |= +Counter(nothing=sum(not x.effects for x in plant.loops))
    content = {"plant": plant, "links": {}, "told": told, "counts": found,
               "said": {x.loop: _numbers(x) for x in plant.loops},
               "still": sum(any(n.code in SILENT for n in x.reasons) for x in plant.loops)}
    bars = {"type": "bar", "orientation": "h", "x": [*found.values()][::-1], "y": [*map(plain_name, found)][::-1],
            "hovertemplate": "%{y}: %{x} loops<extra></extra>"}

    def document() -> dict[str, Any]:
        effects = [{"effect": t.name, "accepted": len(t.loops), "of": len(t.loops) + sum(t.why.values()),
                    "loops": t.loops, "small": t.small, "not_accepted": t.why} for t in told]
        return {"inputs": plant.inputs, "missing": found, "effects": effects,
                "loops": [json_report.judged(x) for x in plant.loops],
                "failures": plant.failures, "warnings": [Note(n.code, n.message) for n in plant.warnings]}

    return Report("effects", entitled("Missing effects", plant.inputs), content, document, lambda: {
        "bars": figure([bars], axis("number of loops"), height=140 + 32 * len(found)) if found else None},
                  counted(len(plant.loops), "loop"))
