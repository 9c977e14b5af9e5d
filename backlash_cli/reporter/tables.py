"""Results as tables for pandas, spreadsheets (CSV) and Parquet: a row per loop or half period; rows of a history."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError
from ..record import Note
from ..results import LoopReport, ScanResult
from .files import write_bytes
from .json_report import half_periods, iso_time, strict
from .safe import spreadsheet

if TYPE_CHECKING:
    import pandas as pd

TABLES = ("loops", "estimates")

# name -> kind: text, number, count, time, flag; the same columns in every report, also an empty one
LOOP_COLUMNS = {
    "loop": "text", "verdict": "text", "confidence": "number", "d": "number", "d_low": "number", "d_high": "number",
    "spread": "number", "cluster_share": "number", "limit_of_detection": "number", "confirmed_d": "number",
    "error_reduction": "number", "delta_bic": "number", "compensator_gain": "number", "compensator_scheme": "text",
    "detections": "count", "half_periods": "count", "long_half_periods": "count", "detection_rate": "number",
    "detections_per_hour": "number", "start": "time", "end": "time", "samples": "count", "interval_s": "number",
    "K": "number", "Ti": "number", "Td": "number", "Kp": "number", "theta": "number", "settings_source": "text",
    "reasons": "text", "warnings": "text",
}
ESTIMATE_COLUMNS = {
    "loop": "text", "start": "time", "end": "time", "dt_s": "number", "dy": "number", "e_max": "number",
    "d": "number", "direction": "count", "accepted": "flag", "why": "text",
}
_COLUMNS = {"loops": LOOP_COLUMNS, "estimates": ESTIMATE_COLUMNS}
_DTYPES = {"text": "string", "number": "float64", "count": "int64", "flag": "bool"}


def _columns(table: str) -> dict[str, str]:
    if table not in TABLES:
        raise UsageError(f"no table {table!r}", where="--table", remedy=f"one of: {', '.join(TABLES)}")
    return _COLUMNS[table]


def _rows(r: LoopReport, table: str) -> list[list[Any]]:
    """The rows of one loop as strict values, in the order of the table's columns."""
    if table == "estimates":
        halves = half_periods(r.estimates)
        return [[strict(r.loop), *row] for row in zip(*halves.values(), strict=True)]
    c, confirmed, s = r.cluster, r.confirmation, r.settings
    said = {
        "d": c and c.d, "d_low": c and c.ci95[0], "d_high": c and c.ci95[1], "cluster_share": c and c.share,
        "confirmed_d": confirmed and confirmed.d, "compensator_gain": r.compensator and r.compensator.gain,
        "compensator_scheme": r.compensator and r.compensator.scheme, "start": iso_time(r.start),
        "end": iso_time(r.end), "settings_source": ", ".join(f"{name} {source}" for name, source in s.source.items()),
        "reasons": _joined(r.reasons), "warnings": _joined(r.warnings),
    }
    own = {"spread": c, "limit_of_detection": c, "error_reduction": confirmed, "delta_bic": confirmed,
           **dict.fromkeys(("K", "Ti", "Td", "Kp", "theta"), s)}
    return [strict([said[n] if n in said else getattr(own.get(n, r), n, None) for n in LOOP_COLUMNS])]


def _joined(notes: Sequence[Note]) -> str:
    return "; ".join(f"{n.code}: {n.message}" for n in notes)


def to_dataframe(result: ScanResult, table: str = "loops") -> pd.DataFrame:
    """Return the result as a pandas DataFrame: a row per loop, or per half period with `table="estimates"`.

    Sizes (d, dy, e_max ...) are parts of the span: 0.03 is 3 %. Times are UTC timestamps. Names are as in the export.
    """
    import pandas as pd

    columns = _columns(table)
    frame = pd.DataFrame([row for r in result.loops for row in _rows(r, table)], columns=list(columns))
    for name, kind in columns.items():
        if kind == "time":
            frame[name] = pd.to_datetime(frame[name], utc=True, format="ISO8601")
    return frame.astype({name: _DTYPES[kind] for name, kind in columns.items() if kind in _DTYPES})


def to_csv(result: ScanResult, table: str = "loops") -> str:
    """Return a table as CSV text; texts that a spreadsheet would run as a formula get an apostrophe in front."""
    return "".join(csv_parts(result, table))


def csv_parts(result: ScanResult, table: str = "loops") -> Iterator[str]:
    """The same text piece by piece, a piece per loop. Raises UsageError for a table that does not exist."""
    heading = csv_text([list(_columns(table))])
    return itertools.chain([heading], (csv_text(_rows(r, table)) for r in result.loops))


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV lines that no spreadsheet runs; every text is quoted, so that a separator of another
    country's spreadsheet cannot open a new cell."""
    out = io.StringIO()
    csv.writer(out, quoting=csv.QUOTE_NONNUMERIC, lineterminator="\n").writerows(map(_csv_cell, row) for row in rows)
    return out.getvalue()


def _csv_cell(value: object) -> object:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else spreadsheet(value)


def write_parquet(result: ScanResult, path: Path, table: str = "loops") -> None:
    """Write a table as Parquet to `path`; names are as in the export, times in UTC."""
    to_dataframe(result, table).to_parquet(path, index=False)


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
    out = io.BytesIO()
    if suffix == ".parquet":
        frame.to_parquet(out, index=False)
    else:
        text = frame.select_dtypes(exclude=["number", "bool", "datetimetz"]).columns
        frame[text] = frame[text].map(spreadsheet)
        frame.to_csv(out, index=False, date_format="%Y-%m-%dT%H:%M:%SZ", encoding="utf-8")
    write_bytes(path, out.getvalue())
