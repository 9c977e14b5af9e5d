"""What `backlash check` found, as a table for people and as JSON for programs."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from ..record import Note
from ..results import PlantResult
from .console import WIDTH, screen
from .json_report import fields_of, header, iso_time, json_text

if TYPE_CHECKING:
    from ..check import LoopCheck
    from ..estimator.identify import Identification

# what the data mean for a verdict, the worst first: word and colour
_EFFECTS = {"failed": ("failed", "bold red"), "blocks": ("no verdict", "bold red"), "limits": ("limited", "yellow"),
            "none": ("good", "green")}


def check_json(result: PlantResult) -> str:
    """Return the whole check as JSON text, ending with a line end; times are ISO 8601 in UTC."""
    return json_text({
        **header(), "inputs": result.inputs, "loops": [_loop(loop) for loop in result.loops],
        "warnings": [fields_of(note) for note in result.warnings],
        "failures": [fields_of(note) for note in result.failures],
    })


def check_text(result: PlantResult, *, verbose: bool = False, colour: bool = False, width: int = WIDTH) -> str:
    """Return the check as text, the worst loops first; `verbose` adds every finding and number of every loop."""
    loops = sorted(result.loops, key=lambda loop: ([*_EFFECTS].index(loop.effect), loop.loop))
    counts = Counter(loop.effect for loop in loops)
    return screen(
        "check.txt", colour=colour, width=min(width, WIDTH), result=result, loops=loops, verbose=verbose,
        effects=_EFFECTS, found_in=_found, findings=_findings,
        counts=", ".join(f"{counts[e]} {word}" for e, (word, _) in _EFFECTS.items() if counts[e]),
        untold=lambda loop: [note for note in _findings(loop) if note.message not in loop.meaning])


def _found(loop: LoopCheck) -> Identification | None:
    return None if loop.identified is None or isinstance(loop.identified, Note) else loop.identified


def _findings(loop: LoopCheck) -> list[Note]:
    """Everything worth saying about a loop, settings first."""
    notes = list(loop.settings_notes)
    found = _found(loop)
    if found is not None:
        notes += found.notes
    elif isinstance(loop.identified, Note) and not notes:
        notes.append(loop.identified)
    if loop.quality is not None:
        told = {note.code for note in loop.notes}
        notes += [note for note in loop.quality.notes if note.code not in told]
    if loop.diagnosis is not None:
        notes.append(loop.diagnosis.note)
    return [*notes, *loop.notes, *([loop.failure] if loop.failure is not None else [])]


def _loop(loop: LoopCheck) -> dict[str, Any]:
    found, diagnosis = _found(loop), loop.diagnosis
    return {
        "loop": loop.loop, "start": iso_time(loop.start), "end": iso_time(loop.end), "effect": loop.effect,
        "meaning": loop.meaning, "settings": {n: getattr(loop.settings, n) for n in ("K", "Ti", "Td", "source")},
        "identified": None if found is None else {
            n: getattr(found, n) for n in ("K", "Ti", "Td", "ratio", "b", "Tf", "r2", "form")},
        "quality": None if loop.quality is None else fields_of(loop.quality, "notes"),
        "oscillation": None if diagnosis is None else {
            "looks_like": diagnosis.kind, "period_s": diagnosis.period, "d": diagnosis.d,
            "statement": diagnosis.statement, "votes": diagnosis.votes},
        "findings": [fields_of(note) for note in _findings(loop)],
    }
