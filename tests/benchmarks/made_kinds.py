"""Exports that are less regular than most, made on the fly: one loop at one second in the many ways plants write it."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv

from tests.benchmarks.made_plant import DAY, signals, write_settings

START = np.datetime64("2026-10-20T00:00:00", "s")  # the clock goes back in Europe five days later


@dataclass(frozen=True)
class Kind:
    """How a file is written. stamp: form of the stamps, or "epoch", "excel", "parts" (date and time of day apart).

    long: rows of tag, time, value. repeat: the header stands before each day. mixed: the days are not in order.
    zone: in which the stamps are written; they go twice through the hour in autumn.
    """

    stamp: str = "%Y-%m-%d %H:%M:%S"
    long: bool = False
    encoding: str = "utf-8"
    repeat: bool = False
    mixed: bool = False
    zone: str = ""


KINDS = {
    "plain": Kind(),
    "cp1252": Kind(encoding="cp1252"),
    "utf16": Kind(encoding="utf-16-le"),
    "day_first": Kind("%d/%m/%Y %H:%M:%S"),
    "epoch": Kind("epoch"),
    "excel": Kind("excel"),
    "parts": Kind("parts"),
    "zone": Kind(zone="Europe/Berlin"),
    "mixed": Kind(mixed=True),
    "repeat": Kind(repeat=True),
    "long": Kind(long=True),
    "long_cp1252": Kind(long=True, encoding="cp1252"),
    "long_repeat": Kind(long=True, repeat=True),
    "long_parts": Kind("parts", long=True),
    "long_zone": Kind(long=True, zone="Europe/Berlin"),
    "long_day_first_zone": Kind("%d.%m.%Y %H:%M:%S", long=True, zone="Europe/Berlin"),
    "long_mixed": Kind(long=True, mixed=True),
}


def write_kind(path: Path, kind: Kind, days: int) -> Path:
    """Write some days of one loop with its settings beside it."""
    order = np.random.default_rng(3).permutation(days) if kind.mixed else np.arange(days)
    with path.open("wb") as file:
        for place, day in enumerate(order.tolist()):
            text = _day(kind, day, header=place == 0 or kind.repeat)
            file.write(text if kind.encoding == "utf-8" else text.decode().encode(kind.encoding))
    write_settings(path, 1)
    return path


def _day(kind: Kind, day: int, header: bool) -> bytes:
    at = START + day * DAY + np.arange(DAY)
    values = dict(zip(("FIC0000.SP", "FIC0000.PV", "FIC0000.OP"), signals(1), strict=True))
    if kind.long:
        columns = {"tag": pa.array(np.tile(list(values), DAY)), **_stamps(kind, np.repeat(at, len(values))),
                   "value": pa.array(np.column_stack(list(values.values())).ravel())}
    else:
        columns = {**_stamps(kind, at), **{name: pa.array(x) for name, x in values.items()}}
    columns["Gerät"] = pa.array(np.full(len(next(iter(columns.values()))), "°C"))
    out = io.BytesIO()
    pa_csv.write_csv(pa.table(columns), out, pa_csv.WriteOptions(include_header=header, quoting_style="none"))
    return out.getvalue()


def _stamps(kind: Kind, at: np.ndarray) -> dict[str, pa.Array]:
    stamps = pa.array(at)
    if kind.zone:
        stamps = pc.local_timestamp(pc.assume_timezone(stamps, "UTC").cast(pa.timestamp("s", kind.zone)))
    if kind.stamp == "epoch":
        return {"time": pa.array(at.astype(np.int64))}
    if kind.stamp == "excel":
        return {"time": pa.array(at.astype(np.int64) / DAY + 25569.0)}
    forms = {"date": "%Y-%m-%d", "time": "%H:%M:%S"} if kind.stamp == "parts" else {"time": kind.stamp}
    # seconds of Arrow carry their fraction: none here
    return {name: pc.strftime(stamps, form) for name, form in forms.items()}
