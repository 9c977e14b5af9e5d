"""Reads a scenario file (TOML): one or more loops to simulate, in seconds and normalised signals.

    [simulation]                    # used by every loop that does not say otherwise
    duration = 3600.0
    step = 0.1
    record_interval = 1.0
    seed = 1
    [loops.FIC101]
    controller = { K = 0.6, Ti = 28.0 }
    process = { gain = 1.3, lags = [20.0, 2.0] }
    setpoint = { level = 0.44, effects = [{ effect = "load_step", times = [600], sizes = [0.02] }] }
    output = 0.3
    effects = [{ effect = "backlash", d = 0.03 }]
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any

from ..errors import MetadataError, UsageError, nearest
from .controller import Compensator, Controller
from .process import Process
from .scenario import Applied, Manual, Recorder, Scenario, Signal, use

SIMULATION = ("duration", "step", "sample_time", "record_interval", "seed", "start")
LOOP = (*SIMULATION, "controller", "process", "setpoint", "output", "effects", "compensator", "manual", "columns",
        "recorder", "pv_range", "op_range", "hidden")  # fmt: skip


def read_toml(path: Path) -> Mapping[str, Any]:
    """Read a TOML file. Raises MetadataError with place and remedy."""
    try:
        return _parsed(path.read_text(encoding="utf-8"), str(path))
    except UnicodeDecodeError as error:
        raise MetadataError("not a text file", where=str(path), remedy="give a TOML file") from error
    except OSError as error:
        remedy = "check the path; backlash simulate example-2 --show prints a scenario to start from"
        raise MetadataError(f"cannot be read: {error.strerror or error}", where=str(path), remedy=remedy) from error


def _parsed(text: str, where: str) -> Mapping[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        remedy = "mend that line (text in quotes, every bracket closed, every key once)"
        raise MetadataError(f"not valid TOML: {error}", where=where, remedy=remedy) from error


def parse_scenarios(text: str, where: str = "scenario") -> tuple[Scenario, ...]:
    """Return the loops described by the text of a scenario file. Raises MetadataError for whatever is wrong."""
    return _scenarios(_parsed(text, where), where)


def _scenarios(document: Mapping[str, Any], where: str) -> tuple[Scenario, ...]:
    _known(document, ("simulation", "loops"), where)
    common, loops = _table(document.get("simulation", {}), f"{where}: [simulation]"), document.get("loops", {})
    _known(common, SIMULATION, f"{where}: [simulation]")
    if not _table(loops, f"{where}: [loops]"):
        raise MetadataError("there is no loop", where=where, remedy="add a table [loops.NAME]")
    return tuple(
        _loop(str(name), {**common, **_table(entry, f"{where}: [loops.{name}]")}, f"{where}: [loops.{name}]", k)
        for k, (name, entry) in enumerate(loops.items())
    )


def loop_seed(seed: int, place: int) -> int:
    """Every loop of a plant has its own random numbers, also where all share one seed."""
    return seed * 100_000 + place


def _loop(name: str, entry: Mapping[str, Any], where: str, place: int) -> Scenario:
    _known(entry, LOOP, where)
    for needed in ("controller", "process", "duration", "step"):
        if needed not in entry:
            raise MetadataError(f"'{needed}' is missing", where=where, remedy=f"add {needed} = ...")
    plain = {key: _number(entry[key], f"{where} {key}") for key in (*LOOP[:4], "output") if key in entry}
    number = _number(entry.get("seed", 0), f"{where} seed")
    if not 0.0 <= number < 1e12 or number % 1.0:
        raise MetadataError(f"{number:g} is not a seed", where=f"{where} seed", remedy="0, 1, 2, ...")
    seed = loop_seed(int(number), place)
    try:
        return Scenario(
            controller=build(Controller, entry["controller"], f"{where} controller"),
            process=build(Process, entry["process"], f"{where} process"),
            effects=_effects(entry.get("effects", ()), f"{where} effects"),
            setpoint=_signal(entry.get("setpoint", {}), f"{where} setpoint"),
            compensator=build(Compensator, entry.get("compensator", {}), f"{where} compensator"),
            manual=tuple(build(Manual, m, f"{where} manual") for m in _list(entry.get("manual", ()), where)),
            columns={
                str(k): _signal(v, f"{where} columns.{k}")
                for k, v in _table(entry.get("columns", {}), f"{where} columns").items()
            },
            recorder=tuple(_recorder(r, f"{where} recorder") for r in _list(entry.get("recorder", ()), where)),
            pv_range=_range(entry.get("pv_range", (0.0, 1.0)), f"{where} pv_range"),
            op_range=_range(entry.get("op_range", (0.0, 1.0)), f"{where} op_range"),
            hidden=tuple(str(h) for h in _list(entry.get("hidden", ()), where)),
            name=name,
            seed=seed,
            start=_start(entry.get("start", 0.0), f"{where} start"),
            **plain,
        )
    except MetadataError as error:
        if error.where.startswith(where):
            raise
        raise MetadataError(error.what, where=where, remedy=error.remedy) from error


def build(cls: Any, entry: object, where: str) -> Any:
    """Make a description object from a table whose keys are its fields."""
    table = _table(entry, where)
    types = {f.name: str(f.type) for f in fields(cls)}
    _known(table, types, where)
    values = {key: _value(value, types[key], f"{where}.{key}") for key, value in table.items()}
    try:
        return cls(**values)
    except TypeError as error:
        missing = [f.name for f in fields(cls) if f.name not in table and repr(f.default).startswith("<dataclasses")]
        raise MetadataError(f"needs {', '.join(missing) or error}", where=where) from error
    except MetadataError as error:
        raise MetadataError(error.what, where=where, remedy=error.remedy) from error


def _value(value: object, kind: str, where: str) -> object:
    """Read a value as the type that its field is declared with: a switch, a list of numbers, or a number."""
    if kind == "bool":
        if not isinstance(value, bool):
            raise MetadataError(f"{value!r} is not true or false", where=where)
        return value
    return tuple(_number(v, where) for v in _list(value, where)) if kind.startswith("tuple") else _number(value, where)


def _effects(entries: object, where: str) -> tuple[Applied, ...]:
    return tuple(_effect(_table(e, where), where) for e in _list(entries, where))


def _effect(table: Mapping[str, Any], where: str) -> Applied:
    if not isinstance(table.get("effect"), str):
        raise MetadataError("an entry names no effect", where=where, remedy='write { effect = "backlash", d = 0.03 }')
    column = table.get("column")
    if column is not None and not isinstance(column, str):
        raise MetadataError(f"{column!r} is not the name of a column", where=where)
    parameters = {k: v for k, v in table.items() if k not in ("effect", "column")}
    try:
        return use(table["effect"], column=column, **parameters)
    except MetadataError as error:
        raise MetadataError(error.what, where=f"{where} {error.where}".strip(), remedy=error.remedy) from error


def _signal(entry: object, where: str) -> Signal:
    if isinstance(entry, int | float) and not isinstance(entry, bool):
        return Signal(float(entry))
    table = _table(entry, where)
    _known(table, ("level", "effects"), where)
    return Signal(_number(table.get("level", 0.0), f"{where}.level"), _effects(table.get("effects", ()), where))


def _recorder(entry: object, where: str) -> Recorder:
    table = dict(_table(entry, where))
    signals = tuple(str(s).upper() for s in _list(table.pop("signals", ("PV", "OP")), where))
    for signal in signals:
        _known({signal: 0}, ("SP", "PV", "OP"), f"{where} signals")
    lines = bool(table.pop("lines", False))
    return Recorder(_effect(table, where), signals, lines)


def _start(value: object, where: str) -> float:
    """Epoch seconds, a TOML date-time, or an ISO text; without a zone it is UTC."""
    if isinstance(value, str):
        try:
            value = datetime.fromisoformat(value)
        except ValueError:
            raise MetadataError(f"'{value}' is not a time", where=where, remedy="2026-03-02T06:00:00Z") from None
    if isinstance(value, datetime):
        return (value if value.tzinfo else value.replace(tzinfo=UTC)).timestamp()
    return _number(value, where)


def _range(value: object, where: str) -> tuple[float, float]:
    ends = [_number(v, where) for v in _list(value, where)]
    if len(ends) != 2 or ends[0] == ends[1]:
        raise MetadataError(f"{value} is not a range", where=where, remedy="give [low, high]")
    return ends[0], ends[1]


def _number(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or value != value:
        raise MetadataError(f"{value!r} is not a number", where=where)
    return float(value)


def _table(value: object, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise MetadataError(f"{value!r} is not a table", where=where, remedy="write { key = value, ... }")
    return value


def _list(value: object, where: str) -> Iterable[Any]:
    if not isinstance(value, list | tuple):
        raise MetadataError(f"{value!r} is not a list", where=where, remedy="write [ ... ]")
    return value


def _known(table: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    names = list(known)
    for key in table:
        if key not in names:
            raise MetadataError(f"unknown key '{key}'", where=where, remedy=nearest(str(key), names))


def scenario_names() -> tuple[str, ...]:
    """Return the names of the scenarios that come with the tool."""
    folder = resources.files(__package__) / "scenarios"
    return tuple(sorted(f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")))


def scenario_text(name: str) -> str:
    """Return the TOML text of a named scenario, to be copied and changed. Raises UsageError for an unknown name."""
    if name not in scenario_names():
        remedy = nearest(name, scenario_names()) + " (or give the path of a TOML file)"
        raise UsageError(f"no scenario '{name}'", remedy=remedy)
    return (resources.files(__package__) / "scenarios" / f"{name}.toml").read_text(encoding="utf-8")


def load_scenarios(name_or_path: str) -> tuple[Scenario, ...]:
    """Return the loops of a named scenario or of a user's own TOML file."""
    if name_or_path.endswith(".toml") or Path(name_or_path).is_file():
        return _scenarios(read_toml(Path(name_or_path)), name_or_path)
    return parse_scenarios(scenario_text(name_or_path), where=name_or_path)


def with_dead_band(scenarios: Iterable[Scenario], d: float | None) -> tuple[Scenario, ...]:
    """Return the loops with dead band d [span] in their valves; None leaves them as they are."""
    if d is None:
        return tuple(scenarios)
    gap = use("backlash", d=d)
    return tuple(replace(s, effects=(gap, *(a for a in s.effects if a.effect is not gap.effect))) for s in scenarios)


def with_seed(scenarios: Iterable[Scenario], seed: int | None) -> tuple[Scenario, ...]:
    """Return the loops with other random numbers; None leaves them as they are."""
    if seed is None:
        return tuple(scenarios)
    return tuple(replace(s, seed=loop_seed(seed, place)) for place, s in enumerate(scenarios))
