"""The report of a scan in the form that was asked for: text, JSON, CSV, Parquet, pages for a browser, pictures."""

import operator
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ..errors import UsageError, nearest
from ..record import Note, Record
from ..results import UNDECIDED, LoopReport, ScanResult, Verdict
from ..words import explained
from . import figures
from .figures import POINTS, Figure, PlantRow
from .files import form_of, make_folder, replacing, write_text
from .json_report import json_parts
from .page import is_page
from .report import LoopPart, Report
from .safe import entitled, file_names
from .tables import csv_parts, to_dataframe
from .templates import sentence
from .words import MARKS, VERDICTS, advice, by_size, excluded, moment, percent, size

DRAWN = 40  # loops in the picture of the plant, and with figures of their own in a single file; a folder has no limit
FINE = 12  # of them with lines as fine as a screen; more share the room, so that a page stays below 3 MB
_SUFFIXES = {".txt": "table", ".json": "json", ".csv": "csv", ".parquet": "parquet", ".html": "html", ".htm": "html"}
_COLOURS = {"bad": "bold red", "warn": "yellow", "good": "green", "quiet": "dim"}

Rule = Callable[[LoopReport], bool]

_RULE = re.compile(r"d\s*(>=|>)\s*(\d+(?:\.\d*)?|\.\d+)\s*(%?)")
_RULES: dict[str, tuple[Verdict, ...]] = {**{str(v): (v,) for v in Verdict if v is not Verdict.NO_BACKLASH},
    "suspected": (Verdict.BACKLASH, Verdict.SUSPECTED),
    "any": (Verdict.BACKLASH, Verdict.SUSPECTED, Verdict.OSCILLATING)}


def check_delivery(form: str | None, output: Path | None, table: str) -> str | None:
    """Return the form to write, from `form` or else the suffix of `output`; None when neither says. Raises UsageError
    for what cannot be, before any work is done."""
    if form is None and output is not None:
        form = form_of(output, _SUFFIXES)
    if form == "parquet" and output is None:
        raise UsageError("Parquet is not for a terminal", where="--format parquet", remedy="add --output FILE.parquet")
    if table != "loops" and form not in ("csv", "parquet"):
        raise UsageError(**explained("no_table_form"), where=f"--table {table}")
    if output is not None and form != "html" and output.is_dir():
        raise UsageError("this is a folder", where=f"--output {output}", remedy="give the name of a file")
    return form


def render(result: ScanResult, records: Mapping[str, Record], form: str, table: str = "loops", *, verbose: bool = False,
           colour: bool = False) -> Iterator[str]:
    """Return the report as text in one of the forms table, json, csv, html; piece by piece, loop by loop."""
    if form in ("json", "csv"):
        return json_parts(result) if form == "json" else csv_parts(result, table)
    found = scanned(result, records)
    return iter([found.page() if form == "html" else found.text(verbose=verbose, colour=colour)])


def write(result: ScanResult, records: Mapping[str, Record], form: str, output: Path, table: str = "loops", *,
          verbose: bool = False, step: Callable[[], None] = lambda: None) -> None:
    """Write the report to a file, or as pages to a folder; the old report stays until the new one is whole. Raises
    BacklashError when the place cannot be written."""
    if form == "parquet":
        with replacing(output) as temporary:
            to_dataframe(result, table).to_parquet(temporary, index=False)
    elif form == "html":
        scanned(result, records, folder=not is_page(output)).write(output, result, step)
    else:
        write_text(output, render(result, records, form, table, verbose=verbose))


def draw(result: ScanResult, records: Mapping[str, Record], folder: Path, step: Callable[[], None] = lambda: None
         ) -> int:
    """Draw a picture (PNG) of the evidence of each loop that was read into `folder`, made if need be; return how many.
    Raises BacklashError when the place cannot be written."""
    from .still import loop_figure, write_still

    make_folder(folder)
    reports = [r for r in result.loops if r.loop in records and r.samples]
    names = file_names(r.loop for r in reports)
    for r in reports:
        write_still(folder / f"{names[r.loop]}.png", loop_figure(records[r.loop], r))
        step()
    return len(reports)


def scanned(result: ScanResult, records: Mapping[str, Record], *, folder: bool = False) -> Report:
    """Return a line per loop, largest dead band first, every reason and warning of every loop when verbose; as a page
    the plant in one picture and the evidence of every loop. On a page that is not the index of a folder the first 40
    loops have figures, all have numbers."""
    reports = by_size(result.loops)
    counts = Counter(r.verdict for r in reports)
    kinds: dict[str, dict[str, Note]] = {}  # code of a warning -> loop -> its first one; the worst loop stands first
    for report in reports:
        for note in report.warnings:
            kinds.setdefault(note.code, {}).setdefault(report.loop, note)
    for code, found in kinds.items():
        weight = {loop: sum(v for v in note.values.values() if isinstance(v, float)) for loop, note in found.items()}
        kinds[code] = {loop: found[loop] for loop in sorted(found, key=weight.__getitem__, reverse=True)}
    shown, cut, room = reports[:DRAWN], not folder and len(reports) > DRAWN, 120  # characters of a reason in the table
    points = POINTS if folder else min(POINTS, POINTS * FINE // max(1, len(shown)))
    starts, ends = ([t for r in reports if (t := getattr(r, edge)) is not None] for edge in ("start", "end"))
    first, last = (moment(min(starts)), moment(max(ends))) if starts and ends else (None, None)
    content = {"result": result, "reports": reports, "shown": shown, "cut": cut, "kinds": kinds, "colours": _COLOURS,
               "said": ", ".join(f"{counts[v]} {words}" for v, words in VERDICTS.items() if counts[v]),
               "undecided": sum(counts[v] for v in UNDECIDED), "room": room, "cut_short": [
                   r.reasons[0] for r in reports if r.verdict is Verdict.ERROR and len(advice(r)) > room]}
    return Report("scan", entitled("Dead band report", result.inputs), content,
                  drawn=lambda: {"picture": plant_picture(shown)}, subtitle=sentence("made", len(reports), first, last),
                  loops=lambda: [LoopPart(r.loop, MARKS[r.verdict], sentence("brief", r), "loop.html",
                                          partial(_evidence, r, {} if cut and place >= DRAWN else records, points))
                                 for place, r in enumerate(reports)])


def _evidence(r: LoopReport, records: Mapping[str, Record], points: int) -> dict[str, Any]:
    """What can be seen with bare eyes first; points: of each line over time."""
    record = records.get(r.loop)  # one at a time is in memory
    found: dict[str, Any] = {"report": r, "undecided": r.verdict in UNDECIDED, "drawn": {}}
    if record is None or not len(record):
        return found
    window = figures.close_look(record, r)
    found["part"] = window.stop - window.start < len(record)
    drawn = {"close": figures.trend(record, r, window, points, room=0.06),
             "trend": figures.trend(record, r, points=points),
             "plane": record.output is not None and figures.plane(record, window, r, points),
             "estimates": r.estimates and figures.estimates(r),
             "profile": r.confirmation and r.confirmation.profile and figures.profile(r)}
    return found | {"drawn": {name: figure for name, figure in drawn.items() if figure}}


def plant_picture(reports: Sequence[LoopReport]) -> Figure:
    """The loops of the work list, worst on top: size with its 95 % interval, or what is excluded; colour by verdict."""
    rows = []
    for r in reports:
        d, below = size(r), excluded(r)
        words = "" if d is not None else VERDICTS[r.verdict] if below is None else f"below {percent(below)}"
        rows.append(PlantRow(r.loop, VERDICTS[r.verdict], MARKS[r.verdict], d, r.cluster.ci95 if r.cluster else None,
                             below, None if d is None else r.limit_of_detection, words, sentence("brief", r)))
    return figures.plant(rows, "limit of detection")


def parse_rules(texts: Iterable[str], where: str = "--fail-on") -> list[Rule]:
    """Return the rules of the given texts; raises UsageError with the known ones for a rule that is none."""
    return [_rule(part.strip(), where) for text in texts for part in text.split(",")]


def met(rules: Sequence[Rule], reports: Iterable[LoopReport]) -> list[str]:
    """Names of the loops that meet one of the rules."""
    return [r.loop for r in reports if any(rule(r) for rule in rules)]


def _rule(text: str, where: str) -> Rule:
    if (known := _RULES.get(text.lower().replace("-", "_"))) is not None:
        return lambda report: report.verdict in known
    if (found := _RULE.fullmatch(text.lower())) is None:
        rules = [*_RULES, "d>0.03", "d>3%"]
        hint = "" if text == "d" else nearest(text, rules)  # a shell takes > and what follows for a file to write
        raise UsageError(**explained("no_rule" if hint.startswith("did") else "no_rule:far", rule=text, hint=hint,
                                     rules=", ".join(rules)), where=where)
    sign, number, per_cent = found.groups()
    limit = float(number) / (100.0 if per_cent else 1.0)
    if limit > 1.0:
        rule = "" if per_cent else f"; did you mean d{sign}{number}% ?"
        raise UsageError(**explained("large_rule", limit=limit, rule=rule), where=f"{where} {text}")
    compare = operator.gt if sign == ">" else operator.ge
    return lambda report: (d := size(report)) is not None and compare(d, limit)
