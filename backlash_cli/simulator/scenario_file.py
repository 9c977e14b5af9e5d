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

The keys of a table are the fields of what it describes: Scenario, Controller, Process, Compensator, Manual, Signal."""

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass, replace
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

from ..errors import MetadataError, UsageError, nearest
from ..toml_text import parsed, read_page
from .process import Process
from .scenario import Applied, Recorder, Scenario, Signal, use

SIMULATION = ("duration", "step", "sample_time", "record_interval", "seed", "start")
PROCESS = "for example --process K=1.3,T=20,L=2 (static gain, lag and dead time in seconds; more lags: T2=..)"
_PROCESS_NAMES = {
    **dict.fromkeys(("k", "kp", "gain"), "gain"), **dict.fromkeys(("l", "theta", "dead_time"), "dead_time"),
    **dict.fromkeys(("t", "t1", "t2", "t3", "t4", "tau", "tau1", "tau2"), "lag")}


def read_toml(path: str) -> dict[str, Any]:
    """Read a TOML file. Raises MetadataError with place and remedy."""
    remedy = "check the path; backlash simulate example-2 --show prints a scenario to start from"
    return parsed(read_page(path, "the file", remedy), path)


def parse_scenarios(page: str | Mapping[str, Any], where: str = "scenario") -> tuple[Scenario, ...]:
    """Return the loops described by a scenario file, text or tables. Raises MetadataError for whatever is wrong."""
    document = parsed(page, where) if isinstance(page, str) else page
    _known(document, ("simulation", "loops"), where)
    common, loops = _table(document.get("simulation", {}), f"{where}: [simulation]"), document.get("loops", {})
    _known(common, SIMULATION, f"{where}: [simulation]")
    for key in sorted(common.keys() - {"start"}):  # here, that no loop is blamed
        _value(get_type_hints(Scenario)[key], common[key], f"{where}: [simulation] {key}")
    if not _table(loops, f"{where}: [loops]"):
        raise MetadataError("there is no loop", where=where, remedy="add a table [loops.NAME]")
    return tuple(_loop(str(name), common, entry, f"{where}: [loops.{name}]", place)
                 for place, (name, entry) in enumerate(loops.items()))


def loop_seed(seed: int, place: int) -> int:
    """Every loop of a plant has its own random numbers, also where all share one seed."""
    return seed * 100_000 + place


def _loop(name: str, common: Mapping[str, Any], entry: object, where: str, place: int) -> Scenario:
    entry = {**common, **_table(entry, where)}
    seed = loop_seed(_value(int, entry.get("seed", 0), f"{where} seed"), place)
    start = entry.get("start", 0.0)
    try:
        start = datetime.fromisoformat(start) if isinstance(start, str) else start
    except ValueError:
        raise MetadataError(f"'{start}' is not a time", where=f"{where} start", remedy="2026-03-02T06:00:00Z") from None
    if isinstance(start, datetime):
        start = (start if start.tzinfo else start.replace(tzinfo=UTC)).timestamp()
    return build(Scenario, {**entry, "name": name, "seed": seed, "start": start}, where)


def build(cls: Any, entry: object, where: str) -> Any:
    """Make a description object from a table whose keys are its fields. Raises MetadataError for whatever is wrong."""
    table, kinds = _table(entry, where), get_type_hints(cls)
    _known(table, kinds, where)
    if missing := [f.name for f in fields(cls) if f.name not in table and f.default is f.default_factory is MISSING]:
        raise MetadataError(f"needs {', '.join(missing)}", where=where, remedy=f"add {missing[0]} = ...")
    between = " " if where.endswith("]") else "."
    values = {key: _value(kinds[key], value, f"{where}{between}{key}") for key, value in table.items()}
    try:
        return cls(**values)
    except MetadataError as error:
        raise MetadataError(error.what, where=where, remedy=error.remedy) from error


def _value(kind: Any, value: object, where: str) -> Any:
    inner, origin = get_args(kind), get_origin(kind)
    if origin is UnionType:
        return _value(inner[0], value, where)
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise MetadataError(f"{value!r} is not a list", where=where, remedy="write [ ... ]")
        items = tuple(_value(inner[0], item, where) for item in value)
        if inner[1] is not Ellipsis and (len(items) != 2 or items[0] == items[1]):
            raise MetadataError(f"{value} is not a range", where=where, remedy="give [low, high]")
        return items
    if origin is not None:
        return {str(k): _value(inner[1], v, f"{where}.{k}") for k, v in _table(value, where).items()}
    if kind is str:
        return str(value)
    if kind is Applied:
        return _effect(_table(value, where), where)
    if kind is Recorder:
        table = dict(_table(value, where))
        signals = tuple(s.upper() for s in _value(tuple[str, ...], table.pop("signals", ("PV", "OP")), where))
        _known(signals, ("SP", "PV", "OP"), f"{where} signals")
        return Recorder(lines=bool(table.pop("lines", False)), applied=_effect(table, where), signals=signals)
    if kind is Signal and isinstance(value, int | float):
        return Signal(_value(float, value, where))
    if is_dataclass(kind):
        return build(kind, value, where)
    if isinstance(value, bool) is not (kind is bool) or not isinstance(value, int | float) or value != value:
        raise MetadataError(f"{value!r} is not {'true or false' if kind is bool else 'a number'}", where=where,
                            remedy="" if kind is bool else "without quotes and unit; times are in seconds")
    if kind is int and (value % 1.0 or not 0 <= value < 1e18):
        raise MetadataError(f"{value:g} is not possible", where=where, remedy="0, 1, 2, ...")
    return kind(value) if kind in (int, bool) else float(value)


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


def _table(value: object, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise MetadataError(f"{value!r} is not a table", where=where, remedy="write { key = value, ... }")
    return value


def _known(keys: Iterable[str], known: Iterable[str], where: str) -> None:
    for key in (key for key in keys if key not in known):
        raise MetadataError(f"unknown key '{key}'", where=where, remedy=nearest(str(key), known))


def scenario_names() -> tuple[str, ...]:
    """Return the names of the scenarios that come with the tool."""
    folder = resources.files(__package__) / "scenarios"
    return tuple(sorted(f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")))


def scenario_text(name: str) -> str:
    """Return the TOML text of a named scenario, to be copied and changed. Raises UsageError for an unknown name."""
    if name not in scenario_names():
        raise UsageError(f"no scenario '{name}'", remedy=f"{nearest(name, scenario_names())} (or give a TOML file)")
    return (resources.files(__package__) / "scenarios" / f"{name}.toml").read_text(encoding="utf-8")


def load_scenarios(name_or_path: str) -> tuple[Scenario, ...]:
    """Return the loops of a named scenario or of a user's own TOML file."""
    if name_or_path.endswith(".toml") or Path(name_or_path).is_file():
        return parse_scenarios(read_toml(name_or_path), name_or_path)
    return parse_scenarios(scenario_text(name_or_path), where=name_or_path)


def with_dead_band(scenarios: Iterable[Scenario], d: float | None) -> tuple[Scenario, ...]:
    """Return the loops with dead band d [span] in their valves; None leaves them as they are."""
    gap = use("backlash", d=d)
    return tuple(s if d is None else replace(s, effects=(gap, *(a for a in s.effects if a.effect is not gap.effect)))
                 for s in scenarios)


def with_seed(scenarios: Iterable[Scenario], seed: int | None) -> tuple[Scenario, ...]:
    """Return the loops with other random numbers; None leaves them as they are."""
    return tuple(s if seed is None else replace(s, seed=loop_seed(seed, k)) for k, s in enumerate(scenarios))


def parse_process(text: str) -> Process:
    """Return the process that a person writes as `K=..,T=..,L=..`, or that of a TOML file.

    Raises MetadataError for unknown names, what is no number, and processes that cannot be.

    >>> found = parse_process("K=1.3, T=20, T2=3, L=2")
    >>> found.gain, found.lags, found.dead_time
    (1.3, (20.0, 3.0), 2.0)"""
    if text.endswith(".toml"):
        table = read_toml(text)
        return build(Process, table.get("process", table), text)
    given: dict[str, float] = {}
    for part in filter(None, (p.strip() for p in text.replace(";", ",").split(","))):
        name, _, value = (x.strip().lower() for x in part.partition("="))
        try:
            number = float(value.removesuffix("s"))
        except ValueError:
            number = float("nan")
        if name not in _PROCESS_NAMES or name in given or number != number:
            near = f"{nearest(name, ['K', 'T', 'T2', 'L'])} - " * (name not in _PROCESS_NAMES)
            raise MetadataError(f"'{part}' is not understood", where="--process", remedy=near + PROCESS)
        given[name] = number
    lags = tuple(value for name, value in given.items() if _PROCESS_NAMES[name] == "lag")
    if not lags:
        raise MetadataError("no lag is given", where="--process", remedy=PROCESS)
    named = {"gain": 1.0, **{_PROCESS_NAMES[name]: value for name, value in given.items()}, "lag": lags}
    return build(Process, {key.replace("lag", "lags"): value for key, value in named.items()}, "--process")
