"""Small exports with known content in the many ways plants write them, made from one seeded recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

START = datetime(2026, 3, 17, 23, 55, 0)
ROWS = 600
RANGES = {"FIC101": (0.0, 900.0), "PIC303": (0.0, 16.0)}
DIGITS = {"FIC101": 2, "PIC303": 4}
SETTINGS = "\n".join(
    f"[loops.{loop}]\nK = 0.9\nTi = 20.0\npv_range = [{low}, {high}]\nop_range = [0, 100]"
    for loop, (low, high) in RANGES.items()
)


def signals(seed: int = 7, rows: int = ROWS) -> dict[str, np.ndarray]:
    """LOOP.SP, LOOP.PV, LOOP.OP in engineering units, rounded as a historian rounds."""
    rng = np.random.default_rng(seed)
    found = {}
    for loop, (low, high) in RANGES.items():
        span, digits = high - low, DIGITS[loop]
        sp = low + span * np.where(np.arange(rows) < rows // 2, 0.45, 0.5)
        pv = sp + span * (0.02 * np.sin(np.arange(rows) / 15.0) + 0.004 * rng.standard_normal(rows))
        op = 40.0 + 5.0 * np.cos(np.arange(rows) / 15.0) + 0.05 * rng.standard_normal(rows)
        found |= {f"{loop}.SP": sp.round(digits), f"{loop}.PV": pv.round(digits), f"{loop}.OP": op.round(2)}
    return found


SIGNALS = signals()
STAMPS = [START + timedelta(seconds=i) for i in range(ROWS)]


@cache
def cell(tag: str, value: float) -> str:
    """Write one value with the digits of its loop."""
    return f"{value:.{2 if tag.endswith('OP') else DIGITS[tag.split('.')[0]]}f}"


@cache
def iso(stamp: datetime) -> str:
    return stamp.strftime("%Y-%m-%dT%H:%M:%S")


def wide(
    time: Callable[[datetime], str] = iso,
    *,
    delimiter: str = ",",
    name: Callable[[str], str] = str,
    value: Callable[[str, float], str] = cell,
    time_name: str = "timestamp",
    before: str = "",
    between: str = "",
    line_end: str = "\n",
    tail: str = "",
) -> str:
    """A wide export; every part of its spelling can be changed."""
    lines = [delimiter.join([time_name, *map(name, SIGNALS)]) + tail]
    lines += between.splitlines()
    rows = rows_of(value, delimiter)
    lines += [f"{time(stamp)}{delimiter}{row}{tail}" for stamp, row in zip(STAMPS, rows, strict=True)]
    return before + line_end.join(lines) + line_end


@cache
def rows_of(value: Callable[[str, float], str], delimiter: str) -> list[str]:
    """The values of each time, joined; made once, for hundreds of exports hold them in the same spelling."""
    return [delimiter.join(value(tag, v[i]) for tag, v in SIGNALS.items()) for i in range(ROWS)]


def long(row: Callable[[str, datetime, str], str], header: str, before: str = "", by_tag: bool = False) -> str:
    """A long export: one line per sample, by time or tag after tag."""
    return before + "\n".join([header, *(row(*sample) for sample in samples(by_tag))]) + "\n"


@cache
def samples(by_tag: bool) -> list[tuple[str, datetime, str]]:
    """Tag, time and value of every sample, by time or tag after tag."""
    found = [(tag, stamp, cell(tag, v[i])) for i, stamp in enumerate(STAMPS) for tag, v in SIGNALS.items()]
    return sorted(found, key=lambda sample: sample[0]) if by_tag else found


@dataclass(frozen=True)
class Export:
    """files: name -> text, bytes or Arrow table. same: the records equal those of the plain export.

    loops: loop name -> loop of the recording it must equal.
    """

    files: dict[str, str | bytes | pa.Table]
    inputs: tuple[str, ...] = ()
    options: dict = field(default_factory=dict)
    loops: dict[str, str] = field(default_factory=lambda: {"FIC101": "FIC101", "PIC303": "PIC303"})
    settings: str = SETTINGS
    start: datetime | None = START
    notes: tuple[str, ...] = ()
    tolerance: float = 1e-9

    def write(self, folder: Path) -> list[Path]:
        """Write the files and the settings; returns the inputs."""
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(content, pa.Table):
                pq.write_table(content, path)
            elif isinstance(content, bytes):
                path.write_bytes(content)
            else:
                path.write_bytes(content.encode("utf-8"))
        (folder / "loops.toml").write_text(self.settings, encoding="utf-8")
        return [folder / name for name in self.inputs or self.files]


def arrow(unit: str = "us", zone: str | None = None) -> pa.Table:
    """The wide export as an Arrow table."""
    stamps = pa.array(STAMPS, pa.timestamp("us")).cast(pa.timestamp(unit))
    if zone:
        stamps = stamps.cast(pa.timestamp(unit, "UTC")).cast(pa.timestamp(unit, zone))
    return pa.table({"timestamp": stamps, **SIGNALS})
