"""What `backlash check` found, as a table for people and as JSON for programs."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from .._version import __version__
from ..record import Note
from .json_report import SCHEMA_VERSION, iso_time, strict
from .safe import terminal

if TYPE_CHECKING:
    from ..check import CheckResult, LoopCheck
    from ..estimator.identify import Identification

WIDTH = 100
WORDS = {"none": "good", "limits": "limited", "blocks": "no verdict", "failed": "failed"}
_COLOURS = {"none": "green", "limits": "yellow", "blocks": "bold red", "failed": "bold red"}
_ORDER = ("failed", "blocks", "limits", "none")


def check_json(result: CheckResult) -> str:
    """Return the whole check as JSON text, ending with a line end; times are ISO 8601 in UTC."""
    document = {
        "schema_version": SCHEMA_VERSION,
        "tool": {"name": "backlash", "version": __version__},
        "inputs": list(result.inputs),
        "loops": [_loop(loop) for loop in result.loops],
        "warnings": [_note(note) for note in result.warnings],
        "failures": [_note(note) for note in result.failures],
    }
    return json.dumps(strict(document), ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def check_text(result: CheckResult, *, verbose: bool = False, colour: bool = False, width: int = WIDTH) -> str:
    """Return the check as text, the worst loops first; `verbose` adds every finding and number of every loop."""
    out = io.StringIO()
    console = Console(
        file=out,
        width=min(width, WIDTH),
        force_terminal=colour,
        color_system="standard" if colour else None,
        highlight=False,
        markup=False,
        emoji=False,
        legacy_windows=False,
    )
    loops = sorted(result.loops, key=lambda loop: (_ORDER.index(loop.effect), loop.loop))
    console.print(_table(loops))
    counts = [f"{n} {WORDS[e]}" for e in _ORDER if (n := sum(loop.effect == e for loop in loops))]
    of = f"{len(loops)} loop{'s' * (len(loops) != 1)}"
    console.print(f"\n{of}: {', '.join(counts)}. K in spans of OP per span of PV, Ti in seconds.")
    for loop in loops:
        _details(console, loop, verbose)
    for title, notes in (("Warnings about the input:", result.warnings), ("Could not be read:", result.failures)):
        if notes:
            console.print(f"\n{title}")
            for note in notes:
                console.print(Text(f"  {terminal(note.message)}"))
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def _table(loops: Sequence[LoopCheck]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    table.add_column("Loop", min_width=6, max_width=20, no_wrap=True, overflow="ellipsis")
    table.add_column("Data", no_wrap=True)
    for name in ("Per Ti", "Usable", "K given", "K found", "Ti given", "Ti found"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("Noted", ratio=1, overflow="fold")
    for loop in loops:
        quality, found, settings = loop.quality, _found(loop), loop.settings
        table.add_row(
            Text(terminal(loop.loop, 40)),
            Text(WORDS[loop.effect], style=_COLOURS[loop.effect]),
            "" if quality is None or quality.samples_per_Ti is None else f"{quality.samples_per_Ti:.3g}",
            "" if quality is None else f"{100 * quality.usable_share:.0f} %",
            "" if settings.K is None else f"{settings.K:.3g}",
            "" if found is None else f"{found.K.value:.3g}",
            "" if settings.Ti is None else f"{settings.Ti:.4g}",
            "" if found is None else f"{found.Ti.value:.3g}",
            Text(_noted(loop)),
        )
    return table


def _noted(loop: LoopCheck) -> str:
    """The codes of what was found, each once."""
    return ", ".join(dict.fromkeys(note.code for note in _findings(loop)))


def _details(console: Console, loop: LoopCheck, verbose: bool) -> None:
    shown = [note for note in _findings(loop) if verbose or note.message not in loop.meaning]
    if not shown and not verbose and loop.meaning == "fit for a verdict":
        return
    heading = Text(f"\n{terminal(loop.loop, 60)}", style="bold")
    console.print(heading + Text(f": {terminal(loop.meaning, 600)}", style="not bold"))
    for note in shown:
        console.print(Text(f"  {note.code}: {terminal(note.message)}"))
    if not verbose:
        return
    quality, found = loop.quality, _found(loop)
    if quality is not None:
        op = "" if quality.output_range is None else f", OP moves over {100 * quality.output_range:.3g} %"
        reversals = quality.output_reversals_per_hour
        turns = "" if reversals is None else f" and turns {reversals:.3g} times an hour"
        console.print(
            Text(
                f"  {quality.samples} samples of {quality.interval:g} s, {quality.duration / 3600:.3g} h; noise of PV "
                f"{100 * quality.pv.noise:.2g} %{op}{turns}"
            )
        )
    if found is not None:
        console.print(Text(f"  settings from the data ({found.form}): {settings_in_words(found)}"))


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
    quality = None if loop.quality is None else {k: v for k, v in asdict(loop.quality).items() if k != "notes"}
    identified: dict[str, Any] | None = None
    if found is not None:
        values = {name: getattr(found, name) for name in ("K", "Ti", "Td", "ratio", "b")}
        identified = {
            **{n: None if v is None else {"value": v.value, "ci95": list(v.ci95)} for n, v in values.items()},
            "Tf": found.Tf,
            "r2": found.r2,
            "form": found.form,
        }
    settings = loop.settings
    return {
        "loop": loop.loop,
        "start": iso_time(loop.start),
        "end": iso_time(loop.end),
        "effect": loop.effect,
        "meaning": loop.meaning,
        "settings": {"K": settings.K, "Ti": settings.Ti, "Td": settings.Td, "source": dict(settings.source)},
        "identified": identified,
        "quality": quality,
        "oscillation": None
        if diagnosis is None
        else {
            "looks_like": diagnosis.kind,
            "period_s": diagnosis.period,
            "d": diagnosis.d,
            "statement": diagnosis.statement,
            "votes": [asdict(vote) for vote in diagnosis.votes],
        },
        "findings": [_note(note) for note in _findings(loop)],
    }


def _note(note: Note) -> dict[str, Any]:
    return {"code": note.code, "message": note.message, "values": dict(note.values)}
