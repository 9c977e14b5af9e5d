"""Results as plain values, and as strict JSON with the fields of the contract; no NaN, no Infinity."""

import math
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from typing import Any

import msgspec
import numpy as np

from .. import results
from .._version import __version__
from ..record import Note

SCHEMA_VERSION = 1
NO_DATE = 2.5e11  # seconds from 1970 beyond which a time is no date (year 9892)
MOMENTS = ("start", "end", "time")  # fields that are epoch seconds


def to_json(result: results.ScanResult) -> str:
    """Return the report of a whole run as JSON text: a line per loop, for people with `grep` and for speed."""
    return "".join(json_parts(result))


def json_parts(result: results.ScanResult) -> Iterator[str]:
    """The same text piece by piece, so that the report of a large plant need not be in memory as a whole."""
    yield _text(strict({**header(), "inputs": result.inputs}))[:-1] + ',\n"loops": ['
    for i, one in enumerate(result.loops):
        yield (",\n" if i else "\n") + _text(loop(one))
    yield "\n],\n" + _text(strict({"warnings": result.warnings, "failures": result.failures}))[1:] + "\n"


def loop(report: results.LoopReport) -> dict[str, Any]:
    """Return one loop's report as plain values, names as in the contract."""
    settings = report.settings
    return dict(strict({**fields_of(report), "settings": {**fields_of(settings), "Tf": settings.filter_time}}))


def header() -> dict[str, Any]:
    """How every document begins."""
    return {"schema_version": SCHEMA_VERSION, "tool": {"name": "backlash", "version": __version__}}


def json_text(document: Mapping[str, Any]) -> str:
    """Return a document as strict JSON text, ending with a line end."""
    return _text(strict(document), 1) + "\n"


def strict(value: Any) -> Any:
    """Return `value` as JSON can say it: numbers to ten digits, NaN and infinity as null, arrays as lists, results by
    the names of their fields as in the contract (numbers of a Note only where there are any), anything else as text."""
    if isinstance(value, float):
        return rounded if math.isfinite(rounded := float(f"{value:.10g}")) else None
    if isinstance(value, str):
        return str(value) if value.isascii() else value.encode("utf-8", "backslashreplace").decode()
    if value is None or isinstance(value, int):
        return value
    if isinstance(value, Mapping):
        return {k if type(k) is str and k.isascii() else strict(str(k)): strict(v) for k, v in value.items()}
    if isinstance(value, results.Estimates):  # nine of ten values of a report: column by column
        columns = {name: (iso_times if name in MOMENTS else strict)(own) for name, own in value.columns().items()}
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    if isinstance(value, Sequence | Set):
        return [strict(v) for v in value]
    if isinstance(value, Note) and not value.values:
        return {"code": strict(value.code), "message": strict(value.message)}
    if is_dataclass(value):
        return strict(fields_of(value))
    return strict(value.tolist() if hasattr(value, "tolist") else str(value))


def fields_of(value: Any, *without: str) -> dict[str, Any]:
    """Return the fields of a result by name, moments as ISO 8601 in UTC, without those named or not in its `repr`."""
    told = {f.name: getattr(value, f.name) for f in fields(value) if f.repr and f.name not in without}
    return told | {name: iso_time(told[name]) for name in MOMENTS if name in told}


def iso_time(epoch: float | None) -> str | None:
    """Return UTC epoch seconds as ISO 8601 text, with a fraction only where there is one; None if not a date.

    >>> iso_time(0.0), iso_time(1.5), iso_time(math.nan)
    ('1970-01-01T00:00:00Z', '1970-01-01T00:00:01.500Z', None)"""
    return iso_times([epoch])[0]


def iso_times(epochs: Sequence[float | None]) -> list[str | None]:
    """Return many times as `iso_time` does one."""
    dates = np.abs(seconds := np.array(epochs, float)) < NO_DATE
    texts = np.rint(1000.0 * np.where(dates, seconds, 0.0)).astype("M8[ms]").astype(str).tolist()
    return [f"{text}Z".replace(".000", "") if date else None for text, date in zip(texts, dates.tolist(), strict=True)]


def judged(found: results.Judged) -> dict[str, Any]:
    """Return a comparison or an explanation with names as in the contract, its values as `strict` takes them."""
    s, kept = found.series, found.model
    first, last = (s.time[[0, -1]].tolist() if s is not None and len(s.time) else (None, None))
    effects = [{"effect": f.effect, "confidence": f.confidence or None, **_fitted(f), "sentence": f.sentence,
                "notes": f.notes} for f in found.effects]
    if isinstance(found, results.Explanation):
        tried = ("effect", "rmse_holdout", "error_reduction", "evidence", "verdict", "why")
        own = {"candidates": [{**{name: getattr(c, name) for name in tried}, **_fitted(c)} for c in found.candidates],
               "margin": found.margin and dict(zip(("evidence", "runner_up"), found.margin, strict=True))}
    else:  # the fields of an explanation: no candidates, and the model's effects as they stand
        assert isinstance(found, results.Comparison)
        steps: list[dict[str, Any]] = [{"added": None, **fields_of(found.baseline, "parameters")}]
        if not found.fitted:
            name = effects[-1]["effect"] if effects else "model"
            steps.append({"added": name, **fields_of(found.fitness, "parameters"), "chosen": "user"})
        own = {"candidates": [], "steps": steps, "missing_effect": None}
    return {**header(), **fields_of(found), "start": iso_time(first), "end": iso_time(last), "effects": effects,
        "samples": None if s is None else s.used.sum(), "model": kept and {**fields_of(kept),
        "effects": [{"effect": e.reference, "column": e.column or None, **e.parameters} for e in kept.effects]}, **own}


def _fitted(found: results.FittedEffect) -> dict[str, Any]:
    """Parameters of an effect; what only says how the record began stands apart."""
    column = {"column": {"value": found.column, "ci95": None, "unit": ""}} if found.column else {}
    own, start = ({name: p for name, p in found.parameters.items() if p.nuisance is nuisance}
                  for nuisance in (False, True))
    return {"parameters": {**column, **own}, "start_values": start}


def _text(value: Any, indent: int = 0) -> str:
    """Plain values as JSON, in one line or in many."""
    return msgspec.json.format(msgspec.json.encode(value), indent=indent).decode()
