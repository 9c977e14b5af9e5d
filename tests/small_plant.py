"""A small simulated plant for tests of commands and reports: three loops, two of them with dead band."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np

from backlash_cli.record import Record
from backlash_cli.simulator import Controller, Process, Scenario, Signal, simulate, use

TRUTH = {"FIC101": 0.03, "TIC202": 0.0, "PIC303": 0.06}


@cache
def records(hours: float = 2.0) -> tuple[Record, ...]:
    """One record per loop of TRUTH, sampled each second, with noise and load steps."""
    return tuple(_record(name, d, hours, seed) for seed, (name, d) in enumerate(TRUTH.items()))


def _record(name: str, d: float, hours: float, seed: int) -> Record:
    duration = 3600.0 * hours
    random = np.random.default_rng(seed)
    times = np.arange(100.0, duration, 300.0) + random.integers(-40, 40, len(np.arange(100.0, duration, 300.0)))
    loads = use("load_step", times=times.tolist(), sizes=random.uniform(-0.1, 0.1, len(times)).tolist())
    return simulate(
        Scenario(
            controller=Controller(K=1.1, Ti=12.0),
            process=Process(gain=1.1, lags=(8.0, 4.0), dead_time=2.0),
            duration=duration,
            step=0.5,
            record_interval=1.0,
            effects=(use("backlash", d=d), loads, use("measurement_noise", density=1e-7)),
            setpoint=Signal(0.5),
            output=0.45,
            seed=seed,
            name=name,
            start=1773734400.0,
        )
    )


def write_plant(folder: Path, names: dict[str, str] | None = None, hours: float = 2.0) -> Path:
    """Write the plant as wide CSV with its settings beside it; `names` renames loops. Returns the CSV file."""
    names = names or {}
    head, columns, settings = ["time"], [], []
    for record in records(hours):
        name = names.get(record.loop, record.loop)
        head += ['"' + f"{name}.{signal}".replace('"', '""') + '"' for signal in ("SP", "PV", "OP")]
        assert record.output is not None
        columns += [record.setpoint, record.measurement, record.output]
        settings.append(
            f"[loops.{json.dumps(name)}]\nK = 1.1\nTi = 12.0\nKp = 1.1\ntheta = 2.0\n"
            "pv_range = [0, 200]\nop_range = [0, 100]\n"
        )
    scale = np.array([200.0, 200.0, 100.0] * len(settings))
    values = np.stack(columns, axis=1) * scale
    stamps = np.datetime_as_string((records(hours)[0].time * 1000).astype("datetime64[ms]"), unit="s")
    lines = [f"{t}," + ",".join(f"{v:.4f}" for v in row) for t, row in zip(stamps, values, strict=True)]
    path = folder / "plant.csv"
    path.write_text("\n".join([",".join(head), *lines]) + "\n", encoding="utf-8")
    (folder / "plant.loops.toml").write_text("\n".join(settings), encoding="utf-8")
    return path
