"""Results as tables for pandas, spreadsheets (CSV) and Parquet: a row per loop or half period; rows of a history."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError
from ..results import LoopReport, ScanResult
from ..results.history import Night, day_of
from ..words import WORDS
from .files import replacing
from .json_report import loop, strict
from .safe import spreadsheet

if TYPE_CHECKING:
    import pandas as pd

# table -> column -> kind (text, number, count, time, flag), and place in a loop of the JSON document where that is not
# its name; the same columns in every report, also an empty one
TABLES: dict[str, dict[str, str]] = WORDS["columns"]
_DTYPES = {"text": "string", "number": "float64", "count": "int64", "flag": "bool", "time": "datetime64[us, UTC]"}


def _columns(table: str) -> dict[str, str]:
    if table not in TABLES:
        raise UsageError(f"no table {table!r}", where="--table", remedy=f"one of: {', '.join(TABLES)}")
    return TABLES[table]


def _rows(r: LoopReport, table: str) -> list[list[Any]]:
    if table == "estimates":
        return [[strict(r.loop), *row.values()] for row in strict(r.estimates)]
    document = loop(replace(r, estimates=()))
    return [[_at(document, (kind.split()[1:] or [name])[0]) for name, kind in TABLES["loops"].items()]]


def _at(document: Any, place: str) -> Any:
    """The value at a place of a document, None where there is none; notes and sources as one text."""
    for name in place.split("."):
        document = None if document is None else document[int(name) if name.isdigit() else name]
    if isinstance(document, list):
        return "; ".join(f"{note['code']}: {note['message']}" for note in document)
    return ", ".join(f"{n} {s}" for n, s in document.items()) if isinstance(document, dict) else document


def to_dataframe(result: ScanResult, table: str = "loops") -> pd.DataFrame:
    """Return the result as a pandas DataFrame: a row per loop, or per half period with `table="estimates"`.

    Sizes (d, dy, e_max ...) are parts of the span: 0.03 is 3 %. Times are UTC timestamps. Names are as in the export.
    Raises UsageError for a table that does not exist."""
    import pandas as pd
    columns = {name: _DTYPES[kind.split()[0]] for name, kind in _columns(table).items()}
    return pd.DataFrame([row for r in result.loops for row in _rows(r, table)], columns=list(columns)).astype(columns)


def csv_parts(result: ScanResult, table: str = "loops") -> Iterator[str]:
    """Return a table as CSV text, a piece per loop; what a spreadsheet would run as a formula gets an apostrophe in
    front. Raises UsageError for a table that does not exist."""
    return itertools.chain([csv_text([list(_columns(table))])], (csv_text(_rows(r, table)) for r in result.loops))


def csv_table(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Return these columns of rows by name as CSV text, empty where a row has no such value."""
    return csv_text([columns, *(strict([row.get(name) for name in columns]) for row in rows)])


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV lines that no spreadsheet runs; every text is quoted, so that a separator of another
    country's spreadsheet cannot open a new cell."""
    out = io.StringIO()
    csv.writer(out, quoting=csv.QUOTE_NONNUMERIC, lineterminator="\n").writerows(
        [str(cell).lower() if isinstance(cell, bool) else "" if cell is None else spreadsheet(cell) for cell in row]
        for row in rows)
    return out.getvalue()


def history_rows(history: Any, table: str, loops: Sequence[str]) -> list[dict[str, Any]]:
    """Return a table of a `history.store.History` as flat rows, dead bands in output spans, times in epoch seconds.
    table: nights, half_periods, repairs, or runs."""
    if table == "nights":
        return [_night_values(night) for loop in loops for night in history.nights(loop)]
    if table == "half_periods":
        return [{"loop": loop, **vars(p)} for loop in loops for p in history.half_periods(loop)]
    if table == "repairs":
        return [{"loop": loop, "time": r.time, "date": day_of(r.time), "note": r.note}
                for loop in loops for r in history.repairs(loop)]
    return [{"start": r["first"], "end": r["last"], "loops": r["loops"], "nights": r["nights"],
             "inputs": ", ".join(r["inputs"]), "failures": "; ".join(n["message"] for n in r["failures"]),
             "tool": r["tool"]} for r in history.runs()]


def _night_values(night: Night) -> dict[str, Any]:
    low, high = night.ci95 or (None, None)
    return {
        "loop": night.loop, "date": day_of(night.time), "start": night.start, "end": night.end,
        "verdict": str(night.verdict), "confidence": night.confidence, "d": night.d, "d_low": low, "d_high": high,
        **{name: getattr(night, name) for name in ("source", "limit_of_detection", "samples", "interval_s",
                                                   "half_periods", "detections")},
        "output_travel_per_hour": night.travel, **{name: night.settings.get(name) for name in ("K", "Ti", "Kp")},
        "reasons": "; ".join(n.message for n in night.reasons), "warnings": "; ".join(n.code for n in night.warnings)}


def write_rows(rows: Sequence[Mapping[str, object]], path: Path) -> None:
    """Write flat rows of a history to a .csv or .parquet file; times (epoch seconds) become UTC."""
    import pandas as pd
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise UsageError(f"cannot export to {path.suffix or 'a file without suffix'}", where=str(path),
                         remedy="give a name that ends in .csv or .parquet")
    frame = pd.DataFrame(rows, columns=None if rows else ["loop"])
    for name in {"start", "end", "time"} & {*frame}:
        frame[name] = pd.to_datetime(frame[name], unit="s", utc=True).dt.round("s")
    with replacing(path) as temporary:
        if suffix == ".parquet":
            frame.to_parquet(temporary, index=False)
        else:
            text = frame.select_dtypes(exclude=["number", "bool", "datetimetz"]).columns
            frame[text] = frame[text].map(spreadsheet)
            frame.to_csv(temporary, index=False, date_format="%Y-%m-%dT%H:%M:%SZ", encoding="utf-8")
