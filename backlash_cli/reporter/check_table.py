"""What `backlash check` found, as a table for people and as JSON for programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..record import Note
from .console import WIDTH, Screen
from .json_report import fields_of, header, iso_time, json_text
from .safe import terminal

if TYPE_CHECKING:
    from ..check import CheckResult, LoopCheck
    from ..estimator.identify import Identification

WORDS = {"none": "good", "limits": "limited", "blocks": "no verdict", "failed": "failed"}
_COLOURS = {"none": "green", "limits": "yellow", "blocks": "bold red", "failed": "bold red"}
_ORDER = ("failed", "blocks", "limits", "none")
_COLUMNS = ("Loop", "Data", ">Per Ti", ">Usable", ">K given", ">K found", ">Ti given", ">Ti found", "Noted")


def check_json(result: CheckResult) -> str:
    """Return the whole check as JSON text, ending with a line end; times are ISO 8601 in UTC."""
    return json_text({
        **header(), "inputs": result.inputs, "loops": [_loop(loop) for loop in result.loops],
        "warnings": [fields_of(note) for note in result.warnings],
        "failures": [fields_of(note) for note in result.failures],
    })


def check_text(result: CheckResult, *, verbose: bool = False, colour: bool = False, width: int = WIDTH) -> str:
    """Return the check as text, the worst loops first; `verbose` adds every finding and number of every loop."""
    screen = Screen(colour=colour, width=min(width, WIDTH))
    loops = sorted(result.loops, key=lambda loop: (_ORDER.index(loop.effect), loop.loop))
    screen.table(_COLUMNS, map(_cells, loops), most=20,
                 styles=[["", _COLOURS[loop.effect], *[""] * 7] for loop in loops])
    counts = [f"{n} {WORDS[e]}" for e in _ORDER if (n := sum(loop.effect == e for loop in loops))]
    of = f"{len(loops)} loop{'s' * (len(loops) != 1)}"
    screen.say(f"\n{of}: {', '.join(counts)}. K in spans of OP per span of PV, Ti in seconds.")
    for loop in loops:
        _details(screen, loop, verbose)
    for title, notes in (("Warnings about the input:", result.warnings), ("Could not be read:", result.failures)):
        if notes:
            screen.say(f"\n{title}")
        for note in notes:
            screen.say(terminal(note.message), indent=2)
    return screen.text()


def _cells(loop: LoopCheck) -> list[str]:
    quality, found, settings = loop.quality, _found(loop), loop.settings
    return [
        terminal(loop.loop, 40), WORDS[loop.effect],
        "" if quality is None or quality.samples_per_Ti is None else f"{quality.samples_per_Ti:.3g}",
        "" if quality is None else f"{100 * quality.usable_share:.0f} %",
        "" if settings.K is None else f"{settings.K:.3g}", "" if found is None else f"{found.K.value:.3g}",
        "" if settings.Ti is None else f"{settings.Ti:.4g}", "" if found is None else f"{found.Ti.value:.3g}",
        ", ".join(dict.fromkeys(note.code for note in _findings(loop))),
    ]


def _details(screen: Screen, loop: LoopCheck, verbose: bool) -> None:
    shown = [note for note in _findings(loop) if verbose or note.message not in loop.meaning]
    if not shown and not verbose and loop.meaning == "fit for a verdict":
        return
    screen.say(f"\n{terminal(loop.loop, 60)}: {terminal(loop.meaning, 600)}", style="bold")
    for note in shown:
        screen.say(f"{note.code}: {terminal(note.message)}", indent=2)
    quality, found = loop.quality, _found(loop)
    if verbose and quality is not None:
        op = "" if quality.output_range is None else f", OP moves over {100 * quality.output_range:.3g} %"
        reversals = quality.output_reversals_per_hour
        turns = "" if reversals is None else f" and turns {reversals:.3g} times an hour"
        screen.say(f"{quality.samples} samples of {quality.interval:g} s, {quality.duration / 3600:.3g} h; noise of PV "
                   f"{100 * quality.pv.noise:.2g} %{op}{turns}", indent=2)
    if verbose and found is not None:
        screen.say(f"settings from the data ({found.form}): {settings_in_words(found)}", indent=2)


def settings_in_words(found: Identification) -> str:
    """Return the identified settings with their 95 % intervals on one line.

    K 0.6 (0.59..0.61), Ti 28 s (27.5..28.6), 99.9 % of OP explained
    """
    parts = [f"K {found.K.value:.3g} ({_span(found.K.ci95)})", f"Ti {found.Ti.value:.3g} s ({_span(found.Ti.ci95)})"]
    if found.Td.value > 0:
        parts.append(f"Td {found.Td.value:.3g} s ({_span(found.Td.ci95)})")
    if found.b is not None:
        parts.append(f"setpoint weight {found.b.value:.2g}")
    return ", ".join([*parts, f"{100 * found.r2:.4g} % of OP explained"])


def _span(ends: tuple[float, float]) -> str:
    return f"{ends[0]:.3g}..{ends[1]:.3g}"


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
