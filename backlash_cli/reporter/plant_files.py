"""Writes records as a historian would export them: CSV or Parquet, with settings and truth beside them."""

import contextlib
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import compute, csv

from ..errors import BacklashError, UsageError
from ..record import Record, SampleState
from ..toml_text import toml_value
from ..words import explained
from .files import replacing, write_text

SUFFIXES = (".csv", ".csv.gz", ".parquet")
SETTINGS = ("K", "Ti", "Td", "Tf", "Kp", "theta", "pv_range", "op_range")
FINEST = 1e-6  # finest step of a written number, in spans: far below any transmitter's resolution


def stem_of(path: Path) -> str:
    """Return the file's name without .csv, .csv.gz or .parquet; UsageError for another suffix."""
    for suffix in SUFFIXES:
        if path.name.endswith(suffix) and path.name != suffix:
            return path.name.removesuffix(suffix)
    raise UsageError(f"cannot write '{path.name}'", remedy=f"let the name end in {', '.join(SUFFIXES)}")


def write_plant(path: Path, records: Sequence[Record], *, layout: str = "wide", finest: float = FINEST) -> None:
    """Write the records of a plant in engineering units, whole or not at all; the suffix of `path` is the format.

    layout: "wide" (a column per signal; all loops need the same times) or "long" (tag, time, value). finest: [span]."""
    stem_of(path)
    table = (_long if layout == "long" else _wide)(records, finest)
    # Arrow puts no time stamp into gzip, so that the same plant gives the same bytes
    packed = "gzip" if path.name.endswith(".gz") else None
    with replacing(path) as temporary, pa.output_stream(str(temporary), compression=packed) as sink:
        if path.name.endswith(".parquet"):
            pq.write_table(table, sink, compression="zstd")
        else:
            names = "".join(name for r in records for name in (r.loop, *r.disturbances))
            style: Literal["needed", "none"] = "needed" if re.search('[,"\r\n]', names) else "none"
            sink.write((",".join(table.column_names) + "\n").encode() if style == "none" else b"")
            place, times = table.schema.get_field_index("timestamp"), table["timestamp"]
            with contextlib.suppress(pa.ArrowInvalid):  # ISO 8601 with Z; milliseconds only where a time has them
                times = times.cast(pa.timestamp("s", tz="UTC"))
            table = table.set_column(place, "timestamp", compute.strftime(times, "%Y-%m-%dT%H:%M:%SZ"))
            csv.write_csv(table, sink, csv.WriteOptions(include_header=style == "needed", quoting_style=style))


def write_settings(path: Path, records: Iterable[Record]) -> None:
    """Write the loops' settings as `loops.toml` that `scan` finds beside the export."""
    lines = ["# Settings of the loops: gains on signals normalised by the ranges, times in seconds."]
    for record in records:
        bare = re.fullmatch("[A-Za-z0-9_-]+", record.loop)
        lines += ["", f"[loops.{record.loop if bare else toml_value(record.loop)}]"]
        lines += [f"{name} = {toml_value(value)}" for name in SETTINGS
                  if (value := getattr(record.settings, name)) is not None and not (name == "Td" and value == 0.0)]
    write_text(path, "\n".join(lines) + "\n")


def write_truth(path: Path, rows: Iterable[Sequence[object]]) -> None:
    """Write what was planted, one row per loop and parameter: loop, effect, parameter, value, unit."""
    columns = ["loop", "effect", "parameter", "value", "unit"]
    write_text(path, pd.DataFrame([*rows], columns=columns).to_csv(index=False, lineterminator="\n"))


def _wide(records: Sequence[Record], finest: float) -> pa.Table:
    first, *others = records
    for record in others:
        if (len(record), record.interval, record.start) != (len(first), first.interval, first.start):
            raise BacklashError(**explained("other_times", loop=record.loop, first=first.loop))
    signals = {f"{r.loop}.{name}": values for r in records for name, values in _signals(r, finest).items()}
    return pa.table({"timestamp": _times(first), **signals})


def _long(records: Sequence[Record], finest: float) -> pa.Table:
    parts = [pa.table({"tag": [f"{r.loop}.{name}"] * len(r), "timestamp": _times(r), "value": values})
             for r in records for name, values in _signals(r, finest).items()]
    if len({part.schema.field("value").type for part in parts}) > 1:
        # one value column holds numbers and modes, so it is text, as historians export it
        parts = [part.set_column(2, "value", part["value"].cast(pa.string())) for part in parts]
    return pa.concat_tables(parts)


def _signals(record: Record, finest: float) -> dict[str, Any]:
    """Columns of one loop in engineering units, name -> (samples,); MODE only where the loop was ever in manual."""
    s, manual = record.settings, record.state == SampleState.MANUAL
    columns: dict[str, Any] = {}
    for name, values, (low, high) in (("SP", record.setpoint, s.pv_range), ("PV", record.measurement, s.pv_range),
                                      ("OP", record.output, s.op_range)):
        if values is not None:
            decimals = max(0, math.ceil(-math.log10(abs(high - low) * finest) - 1e-9))
            columns[name] = np.round(low + (high - low) * values, decimals) + 0.0
    if manual.any():
        columns["MODE"] = np.where(manual, "MAN", "AUTO")
    for name, values in record.disturbances.items():
        # five significant digits of its own swing: the span of a further signal is not known
        columns[name] = np.round(values, max(0, 5 - math.ceil(math.log10(float(np.ptp(values)) or 1.0))))
    return columns


def _times(record: Record) -> Any:
    return pa.array(np.round(record.time * 1e3).astype(np.int64), type=pa.timestamp("ms", tz="UTC"))
