"""What `backlash check` found: a table for people, a document for programs."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from ..record import Note
from ..results import PlantResult
from .json_report import fields_of, iso_time
from .report import Report

if TYPE_CHECKING:
    from ..check import LoopCheck

# what the data mean for a verdict, the worst first: word and colour
EFFECTS = {"failed": ("failed", "bold red"), "blocks": ("no verdict", "bold red"), "limits": ("limited", "yellow"),
           "none": ("good", "green")}


def checked(result: PlantResult) -> Report:
    """Return the check, the worst loops first; verbose: every finding and number of every loop."""
    loops = sorted(result.loops, key=lambda loop: ([*EFFECTS].index(loop.judged.code), loop.loop))
    counts = Counter(loop.judged.code for loop in loops)
    content = {"result": result, "loops": loops, "effects": EFFECTS, "findings": _findings,
               "counts": ", ".join(f"{counts[e]} {word}" for e, (word, _) in EFFECTS.items() if counts[e]),
               "untold": lambda loop: [note for note in _findings(loop) if note.message not in loop.judged.message]}
    return Report("check", "", content, lambda: {"inputs": result.inputs,
        "loops": [_loop(loop) for loop in result.loops], "warnings": [fields_of(note) for note in result.warnings],
        "failures": [fields_of(note) for note in result.failures]})


def _findings(loop: LoopCheck) -> list[Note]:
    told = {note.code for note in loop.notes}
    notes = [*loop.settings_notes] or [note for note in (loop.unidentified,) if note]
    notes += loop.identified.notes if loop.identified else ()
    notes += [note for note in loop.quality.notes if note.code not in told] if loop.quality else ()
    notes += [loop.diagnosis.note] if loop.diagnosis else []
    return [*notes, *loop.notes, *([loop.failure] if loop.failure else [])]


def _loop(loop: LoopCheck) -> dict[str, Any]:
    found, diagnosis = loop.identified, loop.diagnosis
    return {"loop": loop.loop, "start": iso_time(loop.start), "end": iso_time(loop.end), "effect": loop.judged.code,
        "meaning": loop.judged.message, "settings": {n: getattr(loop.settings, n) for n in ("K", "Ti", "Td", "source")},
        "identified": found and {n: getattr(found, n) for n in ("K", "Ti", "Td", "ratio", "b", "Tf", "r2", "form")},
        "quality": loop.quality and fields_of(loop.quality, "notes"), "oscillation": diagnosis
        and {"looks_like": diagnosis.kind, "period_s": diagnosis.period, "d": diagnosis.d,
        "statement": diagnosis.statement, "grounds": diagnosis.grounds},
        "findings": [fields_of(note) for note in _findings(loop)]}
