"""Tables of the history as CSV or Parquet files."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from ..errors import UsageError
from .files import write_bytes
from .safe import spreadsheet

TIMES = ("start", "end", "time")


def write_rows(rows: Sequence[Mapping[str, object]], path: Path) -> None:
    """Write flat rows to `path`, a .csv or .parquet file; times become UTC, text is harmless for a spreadsheet."""
    import pandas as pd

    suffix = path.suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise UsageError(f"cannot export to {path.suffix or 'a file without suffix'}", where=str(path),
                         remedy="give a name that ends in .csv or .parquet")
    frame = pd.DataFrame(rows, columns=None if rows else ["loop"])
    for name in TIMES:
        if name in frame:
            frame[name] = pd.to_datetime(frame[name], unit="s", utc=True).dt.round("s")
    out = io.BytesIO()
    if suffix == ".parquet":
        frame.to_parquet(out, index=False)
    else:
        text = frame.select_dtypes(exclude=["number", "bool", "datetimetz"]).columns
        frame[text] = frame[text].map(spreadsheet)
        frame.to_csv(out, index=False, date_format="%Y-%m-%dT%H:%M:%SZ", encoding="utf-8")
    write_bytes(path, out.getvalue())
