"""Small exports for the commands of the workbench: a flow loop with play, alone or beside another."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from backlash_cli.record import Record
from backlash_cli.simulator import Controller, Process, Scenario, Signal, simulate, use

HEAD = "[defaults]\nK = 0.6\nTi = 28.0\npv_range = [0, 900]\nop_range = [0, 100]\n"


@cache
def record(name: str = "FIC101", d: float = 0.04, seed: int = 1) -> Record:
    """Fifty minutes of a loop with setpoint moves, every 2 s."""
    random = np.random.default_rng(seed)
    times = np.arange(150.0, 3000.0, 350.0)
    moves = use("load_step", times=times.tolist(), sizes=(random.choice([-1, 1], len(times)) * 0.04).tolist())
    return simulate(Scenario(
        controller=Controller(K=0.6, Ti=28.0), process=Process(gain=1.3, lags=(20.0,)), duration=3000.0, step=0.5,
        sample_time=1.0, record_interval=2.0, output=0.4, seed=seed, name=name, start=1773734400.0,
        setpoint=Signal(0.5, (moves, use("random_load", sd=0.004, time_constant=60.0))),
        effects=(use("backlash", d=d), use("measurement_noise", density=1e-6, bandwidth=2.0)),
    ))


def columns(found: Record, name: str) -> tuple[list[str], np.ndarray]:
    """Heads and values (samples, 3) of a loop in engineering units."""
    assert found.output is not None
    values = np.column_stack([900 * found.setpoint, 900 * found.measurement, 100 * found.output])
    return [f"{name}.{signal}" for signal in ("SP", "PV", "OP")], values


def write_csv(path: Path, heads: list[str], values: np.ndarray) -> Path:
    """Write a wide export with its settings beside it."""
    stamps = np.datetime_as_string((record().time * 1000).astype("datetime64[ms]"), unit="s")
    lines = [f"{t}," + ",".join(f"{v:.5g}" for v in row) for t, row in zip(stamps, values, strict=True)]
    path.write_text("\n".join([",".join(["time", *heads]), *lines]) + "\n")
    (path.parent / "loops.toml").write_text(HEAD)
    return path


def write_loop(folder: Path) -> Path:
    """Write an export of FIC101 alone; its valve has 4 % of play."""
    return write_csv(folder / "FIC101.csv", *columns(record(), "FIC101"))


def write_two(folder: Path, *, second_moves: bool = True) -> Path:
    """Write FIC101 with play and FIC102 without; `second_moves` False holds the output of FIC102."""
    heads, values = columns(record(), "FIC101")
    more, others = columns(record("FIC102", 0.0, 2), "FIC102")
    if not second_moves:
        others[:, 2] = 40.0
    return write_csv(folder / "plant.csv", heads + more, np.hstack([values, others]))
