"""Exports as different historians write them, made from a few simulated days: cells, stamps, columns, sizes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from tests.benchmarks.made_plant import DAY, signals

KINDS = 3  # different loops; the others are the same under other names
START = np.datetime64("2026-03-17T00:00:00", "us")
SETTINGS = "K = 0.8\nTi = 20.0\nKp = 1.2\npv_range = [0, 100]\nop_range = [0, 100]\n"


@dataclass(frozen=True)
class Variant:
    """One export. cells: format of numbers in text, "" as they are. stamps: format of times in text, "epoch", or the
    type of a Parquet column. sp: "recorded" or "constant". more: further columns of each loop. noise: of numbers
    with all their digits. options: of the Parquet writer. settings: whether a loops file lies beside."""

    name: str
    suffix: str = ".csv"
    loops: int = 20
    rows: int = DAY // 2
    cells: str = "%.4f"
    stamps: str = "%Y-%m-%d %H:%M:%S"
    sp: str = "recorded"
    more: tuple[str, ...] = ()
    kind: str = "float64"
    digits: bool = False
    options: tuple[tuple[str, object], ...] = ()
    settings: bool = True


def write(folder: Path, variant: Variant) -> Path:
    """Write the file of a variant, and its loops file."""
    path = folder / f"plant{variant.suffix}"
    text = variant.suffix == ".csv"
    names, columns = ["time"], [_stamps(variant)]
    made = [_loop(variant, k) for k in range(min(KINDS, variant.loops))]
    for j in range(variant.loops):
        for role, column in made[j % KINDS].items():
            names.append(f"FIC{j:04d}.{role}")
            columns.append(column)
    table = pa.table(columns, names)
    if text:
        pa_csv.write_csv(table, path, pa_csv.WriteOptions(quoting_style="none"))
    else:
        pa_parquet.write_table(table, path, **dict(variant.options))
    beside = path.with_suffix(".loops.toml")
    beside.unlink(missing_ok=True)
    if variant.settings:
        beside.write_text("".join(f"[loops.FIC{j:04d}]\n{SETTINGS}" for j in range(variant.loops)), "utf-8")
    return path


def _stamps(variant: Variant) -> pa.Array:
    micros = START + 1_000_000 * np.arange(variant.rows)
    if variant.suffix != ".csv":
        unit, _, zone = variant.stamps.partition(" ")
        return pa.array(micros).cast(pa.timestamp(unit, zone or None))
    if variant.stamps == "epoch":
        return pa.array(micros.astype(np.int64) // 1_000_000)
    import pandas as pd

    return pa.array(pd.DatetimeIndex(micros).strftime(variant.stamps), pa.string())


def _loop(variant: Variant, k: int) -> dict[str, pa.Array]:
    at = np.arange(variant.rows) % DAY
    found: dict[str, pa.Array] = {}
    for role, values in zip(("SP", "PV", "OP"), signals(k), strict=True):
        values = values[at]
        if role == "SP" and variant.sp == "constant":
            values = np.full(len(values), 50.0)
        elif variant.digits:
            values = values + np.random.default_rng(k).uniform(0.0, 1e-4, len(values))
        found[role] = _cells(values, variant)
    words = {"MODE": "AUTO", "QUALITY": "Good", "STATUS": "192", "PV.Quality": "Good"}
    for column in variant.more:
        cells: list[str] | np.ndarray = np.full(variant.rows, words[column]).astype(object)
        if column == "MODE":  # an operator's hand now and then
            cells = np.where(at % 20_000 < 300, "MAN", cells)
        if column == "STATUS":
            found[column] = pa.array(np.full(variant.rows, 192))
        else:
            found[column] = pa.array(cells, pa.string())
    return found


def _cells(values: np.ndarray, variant: Variant) -> pa.Array:
    if variant.suffix == ".csv" and variant.cells:
        return pa.array([variant.cells % value for value in values.tolist()], pa.string())
    kind = {"float64": pa.float64(), "float32": pa.float32(), "int32": pa.int32()}[variant.kind]
    return pa.array(np.rint(values * 100) if variant.kind == "int32" else values, pa.float64()).cast(kind)


def _parquet(name: str, **given: object) -> Variant:
    given.setdefault("stamps", "us")
    return Variant(name, ".parquet", **given)  # type: ignore[arg-type]


VARIANTS = (
    Variant("as written by most"),
    Variant("%.3f", cells="%.3f"),
    Variant("%g", cells="%g"),
    Variant("17 digits", cells="", digits=True),
    Variant("exponents", cells="%.6e"),
    Variant("constant SP", sp="constant"),
    Variant("ISO T", stamps="%Y-%m-%dT%H:%M:%S"),
    Variant("ISO T Z", stamps="%Y-%m-%dT%H:%M:%SZ"),
    Variant("ISO fractions", stamps="%Y-%m-%d %H:%M:%S.%f"),
    Variant("ISO T fractions Z", stamps="%Y-%m-%dT%H:%M:%S.%fZ"),
    Variant("ISO offset", stamps="%Y-%m-%d %H:%M:%S+00:00"),
    Variant("epoch seconds", stamps="epoch"),
    Variant("day first", stamps="%d.%m.%Y %H:%M:%S"),
    Variant("MODE", more=("MODE",)),
    Variant("quality of PV", more=("PV.Quality",)),
    Variant("quality numbers", more=("STATUS",)),
    Variant("no settings", settings=False),
    Variant("200 loops, 8,640 rows", loops=200, rows=8640),
    Variant("1,000 loops, 3,456 rows", loops=1000, rows=3456),
    Variant("5 loops, 400,000 rows", loops=5, rows=400_000),
    _parquet("Parquet as written by most"),
    _parquet("Parquet 17 digits", digits=True),
    _parquet("Parquet float32", kind="float32"),
    _parquet("Parquet whole numbers", kind="int32"),
    _parquet("Parquet constant SP", sp="constant"),
    _parquet("Parquet no dictionary", options=(("use_dictionary", False),)),
    _parquet("Parquet zstd", options=(("compression", "zstd"),)),
    _parquet("Parquet uncompressed", options=(("compression", "none"),)),
    _parquet("Parquet 10 row groups", options=(("row_group_size", DAY // 20),)),
    _parquet("Parquet ns", stamps="ns"),
    _parquet("Parquet ms UTC", stamps="ms UTC"),
    _parquet("Parquet MODE", more=("MODE",)),
    _parquet("Parquet quality of PV", more=("PV.Quality",)),
    _parquet("Parquet no settings", settings=False),
    _parquet("Parquet 200 loops, 8,640 rows", loops=200, rows=8640),
    _parquet("Parquet 1,000 loops, 3,456 rows", loops=1000, rows=3456),
    _parquet("Parquet 5 loops, 400,000 rows", loops=5, rows=400_000),
)

