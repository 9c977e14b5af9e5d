"""How often each effect was accepted in a plant, and why not in the other loops; gaps in the valve counted together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..record import Note
from ..results import Candidate, Explanation, FittedEffect, PlantExplanation, gap_size
from .explain_words import NOT_EXPLAINED, NOT_TRIED, WHY, plain_name

SILENT = ("too_little_motion", NOT_EXPLAINED)


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
    def total(self) -> int:
        """All loops of the plant."""
        return len(self.loops) + sum(self.why.values())


def tallies(plant: PlantExplanation) -> list[Tally]:
    """Return all gaps in the valve together, then each effect that was tried, most accepted first."""
    names = list(dict.fromkeys(c.effect for x in plant.loops for c in _all(x)))
    gaps = [n for n in names if any(gap_size(c) is not None for x in plant.loops for c in _all(x) if c.effect == n)]
    single = [_tally(plant, plain_name(str(name)), [name]) for name in names]
    single.sort(key=lambda t: -len(t.loops))
    together = _tally(plant, " or ".join(map(plain_name, sorted(gaps))), gaps)
    return [*([together] if len(gaps) > 1 else []), *single]


def _tally(plant: PlantExplanation, words: str, names: Sequence[str]) -> Tally:
    have = [x for x in plant.loops if any(e.effect in names for e in x.effects)]
    small = [x.loop for x in have if any(e.notes for e in x.effects if e.effect in names)]
    why = Counter(reason(x, names)[0] for x in plant.loops if x not in have)
    if plant.failures:
        why[NOT_EXPLAINED] = len(plant.failures)
    return Tally(words, tuple(x.loop for x in have), tuple(small), dict(why.most_common()))


def reason(x: Explanation, names: Iterable[str]) -> tuple[str, str]:
    """Return code and sentence of why none of these effects was accepted; of the best of those that were tried."""
    for note in x.reasons:
        if note.code in SILENT:
            return note.code, note.message
    tried = [c for name in names for c in x.candidates if c.effect == name and c.why is not None]
    if not tried:
        return NOT_TRIED, WHY[NOT_TRIED]
    best = max(tried, key=lambda c: c.evidence if c.evidence is not None else float("-inf"))
    assert best.why is not None
    return best.why.code, best.why.message


def valve_reason(x: Explanation) -> tuple[str, str] | None:
    """Why no gap was found in the valve of a loop: code and sentence; None where one was accepted."""
    if any(gap_size(e) is not None for e in x.effects):
        return None
    return reason(x, [c.effect for c in x.candidates if gap_size(c) is not None])


def gap_notes(x: Explanation) -> list[Note]:
    """What makes an accepted gap of a loop doubtful or harmless."""
    return [note for e in x.effects for note in e.notes]


def why_words(t: Tally) -> str:
    """The reasons of a tally in words, the most frequent first; those of whole loops are told once (`silent_words`)."""
    return "; ".join(f"{k} {WHY.get(code, code)}" for code, k in t.why.items() if code not in SILENT)


def silent_words(plant: PlantExplanation) -> str:
    """How many loops tell nothing about any effect; empty when all do."""
    still = sum(any(n.code in SILENT for n in x.reasons) for x in plant.loops)
    said = [f"in {still} PV moves too little to tell"] if still else []
    said += [f"{len(plant.failures)} could not be explained"] if plant.failures else []
    total, rest = len(plant.loops) + len(plant.failures), len(plant.loops) - still
    return f"Of {total} loops, {' and '.join(said)}. In the other {rest}:" if said else ""


def as_json(plant: PlantExplanation) -> list[dict[str, Any]]:
    """The tallies as plain values."""
    return [{"effect": t.name, "accepted": len(t.loops), "of": t.total, "loops": list(t.loops), "small": list(t.small),
             "not_accepted": t.why} for t in tallies(plant)]


def _all(x: Explanation) -> list[Candidate | FittedEffect]:
    return [*x.effects, *x.candidates]

