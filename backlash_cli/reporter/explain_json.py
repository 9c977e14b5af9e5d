"""Comparison and explanation as strict JSON with the fields of the contract; no NaN, no Infinity."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from .._version import __version__
from ..record import Note
from ..results import Candidate, Comparison, Explanation, Fitness, FittedEffect, FittedParameter, Model, Region, Step
from .json_report import iso_time, strict

SCHEMA_VERSION = 1


def to_json(found: Comparison | Explanation) -> str:
    """Return one loop's comparison or explanation as JSON text, ending with a line end."""
    document = comparison(found) if isinstance(found, Comparison) else explanation(found)
    return json.dumps(strict(document), ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def explanation(e: Explanation) -> dict[str, Any]:
    """Return an explanation as plain values, names as in the contract."""
    return {
        **_head(e),
        "candidates": [_candidate(c) for c in e.candidates],
        "steps": [_step(s) for s in e.steps],
        "effects": [_effect(f) for f in e.effects],
        "missing_effect": e.missing_effect,
        "where": [_region(r) for r in e.where],
        "where_before": [_region(r) for r in e.where_before],
        "unexplained": e.unexplained,
        "adequate": e.adequate,
        "rest": None if e.rest is None else {"times_noise": e.rest.times_noise, "goes_with": list(e.rest.goes_with)},
        "verdict": e.verdict,
        "reasons": [_note(n) for n in e.reasons],
        "look_alikes": [list(pair) for pair in e.look_alikes],
        "margin": None if e.margin is None else {"evidence": e.margin[0], "runner_up": e.margin[1]},
        "final": None if e.final is None else _fitness(e.final),
        **_tail(e),
    }


def comparison(c: Comparison) -> dict[str, Any]:
    """Return a comparison in the same fields: no candidates, and the model's effects as they stand."""
    steps: list[dict[str, Any]] = [{"added": None, "rmse_holdout": c.baseline.rmse_holdout, "rmse": c.baseline.rmse}]
    if not c.fitted:
        name = c.effects[-1].effect if c.effects else "model"
        last = {"added": name, "rmse_holdout": c.fitness.rmse_holdout, "rmse": c.fitness.rmse}
        steps.append({**last, "chosen": "user"})
    return {
        **_head(c),
        "fitness": _fitness(c.fitness),
        "fitted": c.fitted,
        "seen": c.seen,
        "candidates": [],
        "steps": steps,
        "effects": [_effect(f) for f in c.effects],
        "missing_effect": None,
        "where": [_region(r) for r in c.where],
        "unexplained": c.unexplained,
        "reasons": [_note(n) for n in c.reasons],
        **_tail(c),
    }


def _head(found: Comparison | Explanation) -> dict[str, Any]:
    s = found.series
    times = s.time if s is not None and len(s.time) else None
    return {
        "schema_version": SCHEMA_VERSION,
        "tool": {"name": "backlash", "version": __version__},
        "loop": found.loop,
        "start": None if times is None else iso_time(float(times[0])),
        "end": None if times is None else iso_time(float(times[-1])),
        "samples": None if s is None else int(s.used.sum()),
        "baseline": _fitness(found.baseline),
        "noise_floor": found.noise_floor,
    }


def _tail(found: Comparison | Explanation) -> dict[str, Any]:
    return {
        "model": None if found.model is None else _model(found.model),
        "warnings": [_note(n) for n in found.warnings],
        "details": dict(found.details),
    }


def _step(s: Step) -> dict[str, Any]:
    return {"added": s.added, "rmse_holdout": s.rmse_holdout, "rmse": s.rmse, "chosen": s.chosen}


def _fitness(f: Fitness) -> dict[str, Any]:
    return {"rmse": f.rmse, "rmse_holdout": f.rmse_holdout, "parameters": _parameters(f.parameters)}


def _parameters(given: Mapping[str, FittedParameter], *, nuisance: bool = False) -> dict[str, Any]:
    return {
        name: {"value": p.value, "ci95": p.ci95, "unit": p.unit} for name, p in given.items() if p.nuisance is nuisance
    }


def _numbers(found: FittedEffect | Candidate) -> dict[str, Any]:
    """Parameters of an effect; what only says how the record began stands apart."""
    column = {"column": {"value": found.column, "ci95": None, "unit": ""}} if found.column else {}
    return {
        "parameters": {**column, **_parameters(found.parameters)},
        "start_values": _parameters(found.parameters, nuisance=True),
    }


def _candidate(c: Candidate) -> dict[str, Any]:
    return {
        "effect": c.effect, "rmse_holdout": c.rmse_holdout, "error_reduction": c.error_reduction, **_numbers(c),
        "evidence": c.evidence, "verdict": c.verdict, "why": None if c.why is None else _note(c.why),
    }


def _effect(f: FittedEffect) -> dict[str, Any]:
    notes = [_note(n) for n in f.notes]
    return {
        "effect": f.effect, "confidence": f.confidence or None, **_numbers(f), "sentence": f.sentence, "notes": notes,
    }


def _region(r: Region) -> dict[str, Any]:
    return {
        "region": r.region, "rmse": r.rmse, "share": r.share, "samples": r.samples, "kind": r.kind,
        "expected": r.expected, "sentence": r.sentence,
    }


def _model(m: Model) -> dict[str, Any]:
    return {
        "loop": m.loop, "Kp": m.Kp, "tau": m.tau, "theta": m.theta, "offset": m.offset,
        "effects": [{"effect": e.reference, "column": e.column or None, **e.parameters} for e in m.effects],
        "start": iso_time(m.start), "end": iso_time(m.end), "interval": m.interval,
        "pv_range": m.pv_range, "op_range": m.op_range, "output": m.output,
    }


def _note(note: Note) -> dict[str, Any]:
    plain: dict[str, Any] = {"code": note.code, "message": note.message}
    return {**plain, "values": dict(note.values)} if note.values else plain
