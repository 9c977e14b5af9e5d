"""Comparison, explanation and the summary of a plant: one model against one record, how an explanation was found, which
effect is missing in how many loops, and why not in the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import UsageError
from ..record import Note
from ..results import Comparison, Explanation, PlantExplanation
from . import explain_figures as figures
from . import json_report
from .figures import axis
from .report import Report
from .still import still, write_still
from .tables import csv_text
from .templates import sentence
from .words import error_size, plain_name, rung, said_numbers, several

DPI = 80
SILENT = ("too_little_motion", "not_explained")
COLUMNS = ("loop", "missing_effect", "effects", "numbers", "rmse_baseline", "rmse_final", "noise_floor",
           "error_reduction", "unexplained", "look_alikes", "gap_small", "no_gap", "no_gap_because", "verdict",
           "warnings", "failure")


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
    if isinstance(found, Comparison):
        if series is None:
            return dict.fromkeys(("overlay", "beside", "causes"))
        models = {sentence("predicted", found): series.predicted}
        overlay = figures.overlay(series, models, found.settings, floor, found.where)
        return {"overlay": overlay, "beside": figures.plane(series, found.settings),
                "causes": figures.causes(series, {"this model": series.predicted}, floor)}
    bars, steps = figures.ladder_bars(found.steps, floor), found.steps
    if series is None:
        return {"overlay": None, "beside": bars, "causes": None}
    first = steps[0].prediction if steps and found.effects else None
    models = {"model": series.predicted} if first is None else {"plain model": first, "final model": series.predicted}
    known = {f"{k}: {rung(s)}, {error_size(s.rmse_holdout)}": s.prediction for k, s in enumerate(steps)
             if s.prediction is not None}
    return {"overlay": figures.overlay(series, known, found.settings, floor) if known else None, "beside": bars,
            "causes": figures.causes(series, models, floor)}


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
    if isinstance(found, Comparison):
        title, words = f"{title}, hold-out error {error_size(found.fitness.rmse_holdout)}", "PV against OP"
    # mean residual against the time since OP turned, the mark of play and stiction
    turns = [(cause, figure) for cause, _, figure in drawn["causes"][:1]]
    write_still(path, still(title, [[(words, drawn["beside"]), *turns], [("", drawn["overlay"])]], (1.0, 2.2),
                            (9.5, 8.5)), DPI)


@dataclass(frozen=True)
class Tally:
    """One effect, or several counted together: in which loops it was accepted, where it is small, and why not else."""

    name: str
    loops: tuple[str, ...]
    small: tuple[str, ...] = ()
    why: dict[str, int] = field(default_factory=dict)  # code -> number of the other loops

    @property
    def words(self) -> str:
        """The reasons, the most frequent first; those of whole loops are told once (`silent` of the sentences)."""
        return "; ".join(f"{k} {sentence('why', code)}" for code, k in self.why.items() if code not in SILENT)


def tallies(plant: PlantExplanation) -> list[Tally]:
    """Return all gaps in the valve together, then each effect that was tried, most accepted first."""
    tried = [one for x in plant.loops for one in (*x.effects, *x.candidates)]
    names = list(dict.fromkeys(one.effect for one in tried))
    gaps = [n for n in names if any(one.gap is not None for one in tried if one.effect == n)]
    single = sorted((_tally(plant, [name]) for name in names), key=lambda t: -len(t.loops))
    return [_tally(plant, gaps), *single] if len(gaps) > 1 else single


def _tally(plant: PlantExplanation, names: Sequence[str]) -> Tally:
    have = [x for x in plant.loops if any(e.effect in names for e in x.effects)]
    small = [x.loop for x in have if any(e.notes for e in x.effects if e.effect in names)]
    why = Counter(reason(x, names)[0] for x in plant.loops if x not in have)
    if plant.failures:
        why["not_explained"] = len(plant.failures)
    return Tally(" or ".join(map(plain_name, sorted(names))), tuple(x.loop for x in have), tuple(small),
                 dict(why.most_common()))


def reason(x: Explanation, names: Iterable[str]) -> tuple[str, str]:
    """Return code and sentence of why none of these effects was accepted; of the best of those that were tried."""
    tried = [(c.evidence if c.evidence is not None else float("-inf"), c.why)
             for name in names for c in x.candidates if c.effect == name and c.why is not None]
    whole = next((note for note in x.reasons if note.code in SILENT), None)
    why = whole or max(tried, key=lambda one: one[0], default=(0.0, Note("not_tried", sentence("why", "not_tried"))))[1]
    return why.code, why.message


def valve_reason(x: Explanation) -> tuple[str, str] | None:
    """Why no gap was found in the valve of a loop: code and sentence; None where one was accepted."""
    if any(e.gap is not None for e in x.effects):
        return None
    return reason(x, [c.effect for c in x.candidates if c.gap is not None])


def counts(plant: PlantExplanation) -> dict[str, int]:
    """Return in how many loops each effect is missing, most first; "nothing" counts the loops that lack none."""
    found = Counter(e.effect for x in plant.loops for e in x.effects)
    without = sum(not x.effects for x in plant.loops)
    return {**dict(found.most_common()), **({"nothing": without} if without else {})}


def to_csv(plant: PlantExplanation) -> str:
    """Return one row per loop as CSV, those that could not be explained last; errors in parts of the PV span."""
    lost = [{"loop": n.values.get("loop", n.values.get("file", "")), "failure": n.message} for n in plant.failures]
    rows = ([row.get(name) for name in COLUMNS] for row in (*map(_row, plant.loops), *lost))
    return csv_text([COLUMNS, *map(json_report.strict, rows)])


def _row(x: Explanation) -> dict[str, Any]:
    before, after = x.baseline.rmse_holdout, x.rmse_holdout
    return {
        "loop": x.loop, "missing_effect": x.missing_effect, "effects": "; ".join(e.effect for e in x.effects),
        "numbers": _numbers(x, brief=False), "rmse_baseline": before, "rmse_final": after, "noise_floor": x.noise_floor,
        "error_reduction": 1.0 - (after / before) ** 2 if before > 0 else None, "unexplained": x.unexplained,
        "look_alikes": "; ".join(" = ".join(pair) for pair in x.look_alikes), "verdict": sentence("verdict", x),
        "gap_small": "; ".join(n.message for e in x.effects for n in e.notes),
        **dict(zip(("no_gap", "no_gap_because"), valve_reason(x) or ("", ""), strict=True)),
        "warnings": "; ".join(n.code for n in x.warnings),
    }


def _numbers(x: Explanation, *, brief: bool = True) -> str:
    start = x.model.start if x.model is not None else None
    said = ((brief and several(e, x.settings)) or said_numbers(e, x.settings, start, brief=brief) for e in x.effects)
    return "; ".join(f"{plain_name(e.effect)} {words}{' (small)' * bool(e.notes)}"
                     for e, words in zip(x.effects, said, strict=True))


def summary(plant: PlantExplanation) -> Report:
    """Return which effects are missing in how many loops, why each is not in the others, and which gaps are small.

    The page takes `links`, the addresses of the loops' own pages.
    """
    found, told = counts(plant), tallies(plant)
    content = {"plant": plant, "links": {}, "told": told, "counts": found,
               "said": {x.loop: _numbers(x) for x in plant.loops},
               "still": sum(any(n.code in SILENT for n in x.reasons) for x in plant.loops)}
    bars = {"data": [{"type": "bar", "orientation": "h", "x": list(found.values())[::-1],
                      "y": [plain_name(k) for k in found][::-1], "hovertemplate": "%{y}: %{x} loops<extra></extra>"}],
            "layout": {"xaxis": axis("loops"), "height": 140 + 32 * len(found)}}

    def document() -> dict[str, Any]:
        effects = [{"effect": t.name, "accepted": len(t.loops), "of": len(t.loops) + sum(t.why.values()),
                    "loops": t.loops, "small": t.small, "not_accepted": t.why} for t in told]
        return {"inputs": plant.inputs, "missing": found, "effects": effects,
                "loops": [json_report.judged(x) for x in plant.loops],
                "failures": plant.failures, "warnings": [Note(n.code, n.message) for n in plant.warnings]}

    return Report("effects", "Missing effects", content, document, lambda: {"bars": bars if found else None},
                  f"{len(plant.loops)} loops")
