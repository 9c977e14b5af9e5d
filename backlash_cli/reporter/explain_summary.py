"""Which effect is missing in how many loops of a plant: text, CSV, JSON or a page."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.padding import Padding
from rich.table import Table as TextTable
from rich.text import Text

from .._version import __version__
from ..results import Explanation, FittedEffect, PlantExplanation
from .explain_json import SCHEMA_VERSION, explanation
from .explain_tally import as_json, gap_notes, silent_words, tallies, valve_reason, why_words
from .explain_words import error_size, plain_name, share, verdict
from .json_report import strict
from .loop_page import note_table
from .page import Cell, Section, Table, page
from .parameter_words import numbers, several
from .safe import shorten, spreadsheet, terminal

NOTHING = "nothing"
COLUMNS = ("loop", "missing_effect", "effects", "numbers", "rmse_baseline", "rmse_final", "noise_floor",
           "error_reduction", "unexplained", "look_alikes", "gap_small", "no_gap", "no_gap_because", "verdict",
           "warnings", "failure")


def counts(plant: PlantExplanation) -> dict[str, int]:
    """Return in how many loops each effect is missing, most first; "nothing" counts the loops that lack none."""
    found = Counter(e.effect for x in plant.loops for e in x.effects)
    without = sum(not x.effects for x in plant.loops)
    return {**dict(found.most_common()), **({NOTHING: without} if without else {})}


def rows(plant: PlantExplanation) -> list[dict[str, Any]]:
    """Return one dict per loop with the COLUMNS; loops that could not be explained come last with their reason."""
    lost = [{"loop": n.values.get("loop", n.values.get("file", "")), "failure": n.message} for n in plant.failures]
    return [{**dict.fromkeys(COLUMNS), **row} for row in [*map(_row, plant.loops), *lost]]


def _row(x: Explanation) -> dict[str, Any]:
    before, after = x.baseline.rmse_holdout, x.rmse_holdout
    return {
        "loop": x.loop, "missing_effect": x.missing_effect, "effects": "; ".join(e.effect for e in x.effects),
        "numbers": _numbers(x, brief=False), "rmse_baseline": before, "rmse_final": after, "noise_floor": x.noise_floor,
        "error_reduction": 1.0 - (after / before) ** 2 if before > 0 else None, "unexplained": x.unexplained,
        "look_alikes": "; ".join(" = ".join(pair) for pair in x.look_alikes), "verdict": verdict(x),
        "gap_small": "; ".join(n.message for n in gap_notes(x)),
        **dict(zip(("no_gap", "no_gap_because"), valve_reason(x) or ("", ""), strict=True)),
        "warnings": "; ".join(n.code for n in x.warnings),
    }


def _numbers(x: Explanation, *, brief: bool = True) -> str:
    start = x.model.start if x.model is not None else None

    def said(e: FittedEffect) -> str:
        if brief and (events := several(e, x.settings)):
            return events
        return ", ".join(f"{k} = {v}" for k, v in numbers(e, x.settings, start, brief=brief).items())

    return "; ".join(f"{plain_name(e.effect)} {said(e)}{' (small)' * bool(e.notes)}" for e in x.effects)


def to_csv(plant: PlantExplanation) -> str:
    """Return one row per loop as CSV; errors in parts of the PV span (0.01 = 1 %)."""
    out = io.StringIO()
    writer = csv.DictWriter(out, COLUMNS, quoting=csv.QUOTE_NONNUMERIC, lineterminator="\n")
    writer.writeheader()
    for row in strict(rows(plant)):
        writer.writerow({k: "" if v is None else spreadsheet(v) for k, v in row.items()})
    return out.getvalue()


def to_json(plant: PlantExplanation) -> str:
    """Return the counts, and the whole explanation of every loop, as JSON."""
    document = {
        "schema_version": SCHEMA_VERSION, "tool": {"name": "backlash", "version": __version__},
        "inputs": list(plant.inputs), "missing": counts(plant), "effects": as_json(plant),
        "loops": [explanation(x) for x in plant.loops],
        "failures": [{"code": n.code, "message": n.message, "values": dict(n.values)} for n in plant.failures],
        "warnings": [{"code": n.code, "message": n.message} for n in plant.warnings],
    }
    return json.dumps(strict(document), ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def to_text(plant: PlantExplanation, *, colour: bool = False, width: int = 100) -> str:
    """Return the summary for a terminal."""
    out = io.StringIO()
    console = Console(file=out, width=width, force_terminal=colour, color_system="standard" if colour else None,
                      highlight=False, markup=False, emoji=False, legacy_windows=False)
    table = TextTable(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    table.add_column("Loop", max_width=20, no_wrap=True, overflow="ellipsis")
    for name in ("Baseline", "Final", "Noise"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("Missing effects", ratio=1, overflow="fold")
    for x in plant.loops:
        table.add_row(Text(terminal(x.loop, 40)), error_size(x.baseline.rmse_holdout), error_size(x.rmse_holdout),
                      error_size(x.noise_floor), Text(terminal(_numbers(x) or "nothing is missing", 300)))
    console.print(table)
    console.print(Text("\n" + summary_line(plant)))
    _why_not(console, plant)
    if plant.failures:
        console.print("\nCould not be explained:")
        for note in plant.failures:
            console.print(Padding(Text(f"{note.code}: {terminal(note.message, 300)}"), (0, 0, 0, 2)))
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def _why_not(console: Console, plant: PlantExplanation) -> None:
    """How often each effect was accepted, why not in the other loops, and which gaps are small."""
    table = TextTable(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    table.add_column("Effect", max_width=24, overflow="fold")
    table.add_column("Loops", justify="right", no_wrap=True)
    table.add_column("Why not in the others", ratio=1, overflow="fold")
    for t in tallies(plant):
        table.add_row(t.name, str(len(t.loops)), why_words(t))
    if not table.row_count:
        return
    console.print()
    if said := silent_words(plant):
        console.print(said)
    console.print(table)
    if small := [x for x in plant.loops if gap_notes(x)]:
        console.print("\nFound, but small:")
        for x in small:
            said = f"{terminal(x.loop, 40)}: " + "; ".join(n.message for n in gap_notes(x))
            console.print(Padding(Text(said), (0, 0, 0, 2)))


def summary_line(plant: PlantExplanation) -> str:
    """Return the counts in one sentence."""
    n = len(plant.loops)
    said = ", ".join(f"{plain_name(name)} in {k}" for name, k in counts(plant).items())
    return f"{n} loop{'s' * (n != 1)} explained; missing: {said or NOTHING}. Hold-out errors in % of the PV span."


def _tally_section(plant: PlantExplanation) -> list[Section]:
    rows = [[t.name, len(t.loops), len(t.small) or None, why_words(t) or None] for t in tallies(plant)]
    table = Table(["Effect", "Loops", "Small", "Why not in the others"], rows)
    note = ("Small: less than 1 % of span, as a good valve may have; or crossed by OP within a few samples; or moving "
            "PV hardly more than its noise. The page of the loop tells which.")
    text = [said] if (said := silent_words(plant)) else []
    return [Section("Why found, why not", text=text, table=table, anchor="why", note=note)] if rows else []


def to_page(plant: PlantExplanation, links: Mapping[str, str] | None = None, plotly_file: str = "") -> str:
    """Return the summary as a page; links: addresses of the loops' own pages."""
    links = links or {}
    found = counts(plant)
    bars = {"data": [{"type": "bar", "orientation": "h", "x": list(found.values())[::-1],
                      "y": [plain_name(k) for k in found][::-1], "hovertemplate": "%{y}: %{x} loops<extra></extra>"}],
            "layout": {"xaxis": {"title": {"text": "loops"}}, "height": 140 + 32 * len(found)}}
    table = Table(
        ["Loop", "Missing effects", "Baseline", "Final", "Noise", "Unexplained", "Looks like", "Numbers"],
        [[Cell(x.loop, text=shorten(x.loop, 80), href=links.get(x.loop, "")),
          " + ".join(plain_name(e.effect) for e in x.effects) or NOTHING,
          *(Cell(v, text=error_size(v)) for v in (x.baseline.rmse_holdout, x.rmse_holdout, x.noise_floor)),
          Cell(x.unexplained, text=share(x.unexplained)),
          "; ".join(plain_name(other) for _, other in x.look_alikes) or None, shorten(_numbers(x), 300) or None]
         for x in plant.loops],
        filterable=True, choices="Missing effects",
    )
    sections = [
        Section("Missing in how many loops", text=[summary_line(plant)], figure=bars if found else None),
        *_tally_section(plant),
        Section("Loops", table=table, note="Hold-out errors: root mean square, in % of the PV span, on samples the fit "
                                           "did not see. Looks like: explains the record about equally well, so that "
                                           "it cannot be told apart from what was taken."),
    ]
    if plant.failures:
        sections.append(Section("Could not be explained", table=note_table(plant.failures)))
    return page("Missing effects", sections, subtitle=f"{len(plant.loops)} loops", plotly_file=plotly_file)
