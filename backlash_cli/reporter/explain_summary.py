"""Which effect is missing in how many loops of a plant, and why not in the others: text, CSV, JSON or a page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..record import Note
from ..results import Explanation, PlantExplanation
from .console import WIDTH, screen
from .figures import axis
from .json_report import explanation, header, json_text, strict
from .page import page
from .parameter_words import said_numbers, several
from .tables import csv_text
from .templates import sentence
from .words import plain_name

SILENT = ("too_little_motion", "not_explained")
COLUMNS = ("loop", "missing_effect", "effects", "numbers", "rmse_baseline", "rmse_final", "noise_floor",
           "error_reduction", "unexplained", "look_alikes", "gap_small", "no_gap", "no_gap_because", "verdict",
           "warnings", "failure")


@dataclass(frozen=True)
class Tally:
    """One effect, or several counted together: in which loops it was accepted, where it is small, and why not else.

    loops, small: names of loops. why: code -> number of the other loops.
    """

    name: str
    loops: tuple[str, ...]
    small: tuple[str, ...] = ()
    why: dict[str, int] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """The reasons, the most frequent first; those of whole loops are told once (`silent` of the sentences)."""
        return "; ".join(f"{k} {sentence('why', code)}" for code, k in self.why.items() if code not in SILENT)


def tallies(plant: PlantExplanation) -> list[Tally]:
    """Return all gaps in the valve together, then each effect that was tried, most accepted first."""
    tried = [one for x in plant.loops for one in (*x.effects, *x.candidates)]
    names = list(dict.fromkeys(one.effect for one in tried))
    gaps = [n for n in names if any(one.gap is not None for one in tried if one.effect == n)]
    single = [_tally(plant, plain_name(str(name)), [name]) for name in names]
    together = _tally(plant, " or ".join(map(plain_name, sorted(gaps))), gaps)
    return [*([together] if len(gaps) > 1 else []), *sorted(single, key=lambda t: -len(t.loops))]


def _tally(plant: PlantExplanation, words: str, names: Sequence[str]) -> Tally:
    have = [x for x in plant.loops if any(e.effect in names for e in x.effects)]
    small = [x.loop for x in have if any(e.notes for e in x.effects if e.effect in names)]
    why = Counter(reason(x, names)[0] for x in plant.loops if x not in have)
    if plant.failures:
        why["not_explained"] = len(plant.failures)
    return Tally(words, tuple(x.loop for x in have), tuple(small), dict(why.most_common()))


def reason(x: Explanation, names: Iterable[str]) -> tuple[str, str]:
    """Return code and sentence of why none of these effects was accepted; of the best of those that were tried."""
    for note in x.reasons:
        if note.code in SILENT:
            return note.code, note.message
    tried = [(c.evidence if c.evidence is not None else float("-inf"), c.why)
             for name in names for c in x.candidates if c.effect == name and c.why is not None]
    if not tried:
        return "not_tried", sentence("why", "not_tried")
    best = max(tried, key=lambda one: one[0])[1]
    return best.code, best.message


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


def summary_line(plant: PlantExplanation) -> str:
    """Return the counts in one sentence."""
    return sentence("summary", plant, counts(plant))


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


def to_csv(plant: PlantExplanation) -> str:
    """Return one row per loop as CSV, those that could not be explained last; errors in parts of the PV span."""
    lost = [{"loop": n.values.get("loop", n.values.get("file", "")), "failure": n.message} for n in plant.failures]
    return csv_text([COLUMNS, *(strict([row.get(name) for name in COLUMNS])
                                for row in [*map(_row, plant.loops), *lost])])


def to_json(plant: PlantExplanation) -> str:
    """Return the counts, and the whole explanation of every loop, as JSON."""
    effects = [{"effect": t.name, "accepted": len(t.loops), "of": len(t.loops) + sum(t.why.values()),
                "loops": t.loops, "small": t.small, "not_accepted": t.why} for t in tallies(plant)]
    return json_text({**header(), "inputs": plant.inputs, "missing": counts(plant), "effects": effects,
                      "loops": [explanation(x) for x in plant.loops], "failures": plant.failures,
                      "warnings": [Note(n.code, n.message) for n in plant.warnings]})


def to_text(plant: PlantExplanation, *, colour: bool = False, width: int = WIDTH) -> str:
    """Return the summary for a terminal, why each effect is not in the other loops, and which gaps are small."""
    return screen("effects.txt", colour=colour, width=width, **_content(plant))


def to_page(plant: PlantExplanation, links: Mapping[str, str] | None = None, plotly_file: str = "") -> str:
    """Return the summary as a page; links: addresses of the loops' own pages."""
    found = counts(plant)
    bars = {"data": [{"type": "bar", "orientation": "h", "x": list(found.values())[::-1],
                      "y": [plain_name(k) for k in found][::-1], "hovertemplate": "%{y}: %{x} loops<extra></extra>"}],
            "layout": {"xaxis": axis("loops"), "height": 140 + 32 * len(found)}}
    return page("effects.html", "Missing effects", subtitle=f"{len(plant.loops)} loops", plotly_file=plotly_file,
                links=links or {}, bars=bars if found else None, **_content(plant))


def _content(plant: PlantExplanation) -> dict[str, Any]:
    still = sum(any(n.code in SILENT for n in x.reasons) for x in plant.loops)
    return {"plant": plant, "told": tallies(plant), "still": still, "counts": counts(plant),
            "said": {x.loop: _numbers(x) for x in plant.loops}}
