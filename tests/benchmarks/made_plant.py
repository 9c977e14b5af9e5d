"""Exports of any size, made on the fly: simulated days of a few loops, repeated with other names and later stamps."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from backlash_cli.simulator import Controller, Process, Scenario, Signal, simulate, use

DAY = 86_400
BANDS = (0.0, 0.02, 0.05)  # dead bands of the simulated loops


@cache
def signals(k: int) -> tuple[np.ndarray, ...]:
    """SP, PV, OP of one day of loop k, in per cent with four decimals as historians write them."""
    random = np.random.default_rng(k)
    times = np.arange(200.0, DAY - 200.0, 900.0)
    times = times + random.integers(-200, 200, len(times))
    sizes = random.uniform(-0.1, 0.1, len(times)).tolist()
    record = simulate(Scenario(
        controller=Controller(K=0.8, Ti=20.0), process=Process(gain=1.2, lags=(12.0, 4.0), dead_time=2.0),
        duration=float(DAY), step=1.0, record_interval=1.0, setpoint=Signal(0.5), output=0.45, seed=k, name="loop",
        effects=(use("backlash", d=BANDS[k % 3]), use("load_step", times=times.tolist(), sizes=sizes),
                 use("measurement_noise", density=1e-6)),
    ))
    assert record.output is not None
    return tuple(np.round(100.0 * x[:DAY], 4) for x in (record.setpoint, record.measurement, record.output))


def write(path: Path, loops: int, days: float, kinds: int = 3) -> Path:
    """Write a wide export, a piece of rows at a time, with its settings beside it; the suffix says the format."""
    names = [f"FIC{j:04d}" for j in range(loops)]
    schema = pa.schema([("time", pa.timestamp("s")),
                        *((f"{name}.{role}", pa.float64()) for name in names for role in ("SP", "PV", "OP"))])
    made = pa_csv.CSVWriter(path, schema) if path.suffix == ".csv" else pa_parquet.ParquetWriter(path, schema)
    start = np.datetime64("2026-03-17T00:00:00", "s")
    step = max(1000, min(DAY, 4_000_000 // loops))
    rows = int(days * DAY)
    with made as writer:
        for first in range(0, rows, step):
            at = np.arange(first, min(first + step, rows))
            parts = [tuple(x[at % len(x)] for x in signals(k)) for k in range(kinds)]
            columns = [pa.array(start + at), *(pa.array(x) for j in range(loops) for x in parts[j % kinds])]
            writer.write_table(pa.table(columns, schema=schema))
    write_settings(path, loops)
    return path


def write_settings(path: Path, loops: int) -> None:
    """Write the settings of an export beside it."""
    settings = "K = 0.8\nTi = 20.0\nKp = 1.2\npv_range = [0, 100]\nop_range = [0, 100]\n"
    text = "".join(f"[loops.FIC{j:04d}]\n{settings}" for j in range(loops))
    path.with_suffix(".loops.toml").write_text(text, "utf-8")


def write_long(path: Path, loops: int, days: float, kinds: int = 3) -> Path:
    """Write the same plant as rows of tag, time and value, all tags of a second one after the other."""
    names = [f"FIC{j:04d}.{role}" for j in range(loops) for role in ("SP", "PV", "OP")]
    schema = pa.schema([("tag", pa.string()), ("time", pa.timestamp("s")), ("value", pa.float64())])
    made = pa_csv.CSVWriter(path, schema) if path.suffix == ".csv" else pa_parquet.ParquetWriter(path, schema)
    start = np.datetime64("2026-03-17T00:00:00", "s")
    step = max(1, 2_000_000 // len(names))
    rows = int(days * DAY)
    with made as writer:
        for first in range(0, rows, step):
            at = np.arange(first, min(first + step, rows))
            parts = [tuple(x[at % len(x)] for x in signals(k)) for k in range(kinds)]
            values = np.column_stack([x for j in range(loops) for x in parts[j % kinds]]).ravel()
            tags = pa.DictionaryArray.from_arrays(np.tile(np.arange(len(names), dtype=np.int32), len(at)), names)
            columns = [tags.cast(pa.string()), pa.array(start + np.repeat(at, len(names))), pa.array(values)]
            writer.write_table(pa.table(columns, schema=schema))
    write_settings(path, loops)
    return path


def write_rough(path: Path, days: float) -> Path:
    """Write one loop as plants really export it: words and blanks among numbers, modes, missing rows; no settings.

    Three days are made, then the same come again with later dates: making them takes longer than a scan.
    """
    first = np.datetime64("2026-03-17", "D")
    made = [rough_day(first, seed) for seed in range(3)]
    with path.open("w", encoding="utf-8") as file:
        file.write("time,FIC1.SP,FIC1.PV,FIC1.OP,FIC1.MODE\n")
        for day in range(int(days)):
            file.write(made[day % 3].replace(f"{first}T", f"{first + day}T"))
    return path


@cache
def rough_day(date: np.datetime64, seed: int) -> str:
    """The rows of one day of a rough export."""
    random = np.random.default_rng([7, seed])
    at = np.flatnonzero(random.random(DAY) > 0.001)
    sp, pv, op = (np.char.mod("%.4f", x[at]) for x in signals(1))
    pv[random.random(len(at)) < 0.001] = "Bad"
    op[random.random(len(at)) < 0.001] = ""
    mode = np.where((at // 3600) % 12 == 5, "MAN", "AUTO")
    stamps = np.datetime_as_string(date.astype("datetime64[s]") + at)
    rows = zip(stamps.tolist(), sp.tolist(), pv.tolist(), op.tolist(), mode.tolist(), strict=True)
    return "".join(",".join(row) + "\n" for row in rows)
