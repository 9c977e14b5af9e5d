"""Scan results as tables: one row per loop, or one row per half period, for pandas, CSV and Parquet."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError
from ..record import Note
from ..results import LoopReport, ScanResult
from .columns import NUMBERS, as_columns, numbers, times
from .json_report import iso_time, strict
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


def _columns(table: str) -> dict[str, str]:
    if table not in TABLES:
        raise UsageError(f"no table {table!r}", where="--table", remedy=f"one of: {', '.join(TABLES)}")
    return _COLUMNS[table]


def rows(result: ScanResult, table: str = "loops") -> list[dict[str, Any]]:
    """Return one dict per loop, or per half period of every loop; d in parts of the output span, times ISO UTC.

    Raises UsageError for a table that does not exist.
    """
    _columns(table)
    if table == "loops":
        return [strict(_loop_row(r)) for r in result.loops]
    return [
        strict({
            "loop": r.loop, "start": iso_time(e.start), "end": iso_time(e.end), "dt_s": e.dt_s, "dy": e.dy,
            "e_max": e.e_max, "d": e.d, "direction": e.direction, "accepted": e.accepted, "why": e.why,
        })
        for r in result.loops
        for e in r.estimates
    ]


def _loop_row(r: LoopReport) -> dict[str, Any]:
    c, confirmed, s = r.cluster, r.confirmation, r.settings
    return {
        "loop": r.loop, "verdict": str(r.verdict), "confidence": r.confidence,
        "d": c and c.d, "d_low": c and c.ci95[0], "d_high": c and c.ci95[1],
        "spread": c and c.spread, "cluster_share": c and c.share,
        "limit_of_detection": c and c.limit_of_detection,
        "confirmed_d": confirmed and confirmed.d, "error_reduction": confirmed and confirmed.error_reduction,
        "delta_bic": confirmed and confirmed.delta_bic,
        "compensator_gain": r.compensator and r.compensator.gain,
        "compensator_scheme": r.compensator and r.compensator.scheme,
        "detections": r.detections, "half_periods": r.half_periods, "long_half_periods": r.long_half_periods,
        "detection_rate": r.detection_rate, "detections_per_hour": r.detections_per_hour,
        "start": iso_time(r.start), "end": iso_time(r.end), "samples": r.samples, "interval_s": r.interval_s,
        "K": s.K, "Ti": s.Ti, "Td": s.Td, "Kp": s.Kp, "theta": s.theta,
        "settings_source": ", ".join(f"{name} {source}" for name, source in s.source.items()),
        "reasons": _joined(r.reasons), "warnings": _joined(r.warnings),
    }


def _joined(notes: Sequence[Note]) -> str:
    return "; ".join(f"{n.code}: {n.message}" for n in notes)


def to_dataframe(result: ScanResult, table: str = "loops") -> pd.DataFrame:
    """Return the result as a pandas DataFrame: a row per loop, or per half period with `table="estimates"`.

    Sizes (d, dy, e_max ...) are parts of the span: 0.03 is 3 %. Times are UTC timestamps. Names are as in the export.
    """
    import pandas as pd

    columns = _columns(table)
    data = rows(result, table) if table == "loops" else _estimates(result)
    frame = pd.DataFrame(data, columns=list(columns))
    for name, kind in columns.items():
        if kind == "time":
            frame[name] = pd.to_datetime(frame[name], utc=True, format="ISO8601")
    kinds = {"text": "string", "number": "float64", "count": "int64", "flag": "bool"}
    return frame.astype({name: kinds[kind] for name, kind in columns.items() if kind in kinds})


def _estimates(result: ScanResult) -> dict[str, list[Any]]:
    """The half periods of all loops, a list per column."""
    found: dict[str, list[Any]] = {name: [] for name in ESTIMATE_COLUMNS}
    for report in result.loops:
        e = as_columns(report.estimates)
        why = e.why.tolist()
        found["loop"] += [strict(report.loop)] * len(e)
        found["start"] += times(e.origin + e.begin)
        found["end"] += times(e.origin + (e.begin + e.dt_s))
        for name in NUMBERS:
            found[name] += [float(text) for text in numbers(getattr(e, name), "nan")]
        found["direction"] += e.direction.tolist()
        found["accepted"] += [e.codes[w] == "ok" for w in why]
        found["why"] += [e.codes[w] for w in why]
    return found


def to_csv(result: ScanResult, table: str = "loops") -> str:
    """Return a table as CSV text; texts that a spreadsheet would run as a formula get an apostrophe in front."""
    return "".join(csv_parts(result, table))


def csv_parts(result: ScanResult, table: str = "loops") -> Iterator[str]:
    """The same text piece by piece, a piece per loop. Raises UsageError for a table that does not exist."""
    names = list(_columns(table))
    return itertools.chain([_csv_lines([names])],
                           (_csv_loop(r) if table == "loops" else _csv_estimates(r) for r in result.loops))


def _csv_loop(report: LoopReport) -> str:
    return _csv_lines([[_csv_cell(v) for v in strict(_loop_row(report)).values()]])


def _csv_lines(lines: Iterable[Sequence[object]]) -> str:
    out = io.StringIO()
    # Every text is quoted, so that a separator of another country's spreadsheet cannot open a new cell.
    csv.writer(out, quoting=csv.QUOTE_NONNUMERIC, lineterminator="\n").writerows(lines)
    return out.getvalue()


def _csv_estimates(report: LoopReport) -> str:
    """Lines of all half periods of a loop; only the name and the codes have to be looked at for formulas."""
    e = as_columns(report.estimates)
    name = _csv_lines([[_csv_cell(strict(report.loop))]]).rstrip("\n")
    codes = [_csv_lines([["true" if code == "ok" else "false", _csv_cell(code)]]) for code in e.codes]
    stamps = (times(t) for t in (e.origin + e.begin, e.origin + (e.begin + e.dt_s)))
    sizes = (numbers(getattr(e, n), '""') for n in NUMBERS)
    rows = zip(*stamps, *sizes, e.direction.tolist(), e.why.tolist(), strict=True)
    return "".join([
        f'{name},"{start or ""}","{end or ""}",{dt},{dy},{peak},{d},{sign},{codes[why]}'
        for start, end, dt, dy, peak, d, sign, why in rows
    ])


def _csv_cell(value: object) -> object:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else spreadsheet(value)


def write_parquet(result: ScanResult, path: Path, table: str = "loops") -> None:
    """Write a table as Parquet to `path`; names are as in the export, times in UTC."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    frame = to_dataframe(result, table)
    pq.write_table(pa.Table.from_pandas(frame, preserve_index=False), path)
