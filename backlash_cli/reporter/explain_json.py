"""Comparison and explanation as strict JSON with the fields of the contract; no NaN, no Infinity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..results import Candidate, Comparison, Explanation, Fitness, FittedEffect, FittedParameter, Model
from .json_report import fields_of, header, iso_time, json_text


def to_json(found: Comparison | Explanation) -> str:
    """Return one loop's comparison or explanation as JSON text, ending with a line end."""
    return json_text(comparison(found) if isinstance(found, Comparison) else explanation(found))


def explanation(e: Explanation) -> dict[str, Any]:
    """Return an explanation with names as in the contract, its values as `strict` takes them."""
    return {
        **_head(e),
        "candidates": [
            {**fields_of(c, "parameters", "column", "sentence", "meaning", "stage"), **_numbers(c)}
            for c in e.candidates
        ],
        "steps": [fields_of(s, "prediction") for s in e.steps],
        **{name: getattr(e, name) for name in ("missing_effect", "unexplained", "adequate", "rest", "verdict")},
        "where_before": [fields_of(r, "stretches") for r in e.where_before],
        "look_alikes": e.look_alikes,
        "margin": None if e.margin is None else {"evidence": e.margin[0], "runner_up": e.margin[1]},
        "final": None if e.final is None else _fitness(e.final),
        **_tail(e),
    }


def comparison(c: Comparison) -> dict[str, Any]:
    """Return a comparison in the same fields: no candidates, and the model's effects as they stand."""
    steps: list[dict[str, Any]] = [{"added": None, **fields_of(c.baseline, "parameters")}]
    if not c.fitted:
        name = c.effects[-1].effect if c.effects else "model"
        steps.append({"added": name, **fields_of(c.fitness, "parameters"), "chosen": "user"})
    return {**_head(c), "fitness": _fitness(c.fitness), "fitted": c.fitted, "seen": c.seen, "candidates": [],
            "steps": steps, "missing_effect": None, "unexplained": c.unexplained, **_tail(c)}


def _head(found: Comparison | Explanation) -> dict[str, Any]:
    s = found.series
    first, last = (s.time[[0, -1]].tolist() if s is not None and len(s.time) else (None, None))
    return {
        **header(), "loop": found.loop, "start": iso_time(first), "end": iso_time(last),
        "samples": None if s is None else s.used.sum(), "baseline": _fitness(found.baseline),
        "noise_floor": found.noise_floor,
    }


def _tail(found: Comparison | Explanation) -> dict[str, Any]:
    return {
        "effects": [
            {"effect": f.effect, "confidence": f.confidence or None, **_numbers(f), "sentence": f.sentence,
             "notes": f.notes} for f in found.effects
        ],
        "where": [fields_of(r, "stretches") for r in found.where],
        "reasons": found.reasons,
        "model": None if found.model is None else _model(found.model),
        "warnings": found.warnings,
        "details": found.details,
    }


def _fitness(f: Fitness) -> dict[str, Any]:
    return {"rmse": f.rmse, "rmse_holdout": f.rmse_holdout, "parameters": _parameters(f.parameters)}


def _parameters(given: Mapping[str, FittedParameter], *, nuisance: bool = False) -> dict[str, Any]:
    return {name: {"value": p.value, "ci95": p.ci95, "unit": p.unit} for name, p in given.items()
            if p.nuisance is nuisance}


def _numbers(found: FittedEffect | Candidate) -> dict[str, Any]:
    """Parameters of an effect; what only says how the record began stands apart."""
    column = {"column": {"value": found.column, "ci95": None, "unit": ""}} if found.column else {}
    return {"parameters": {**column, **_parameters(found.parameters)},
            "start_values": _parameters(found.parameters, nuisance=True)}


def _model(m: Model) -> dict[str, Any]:
    return {
        **fields_of(m, "rmse_holdout"), "start": iso_time(m.start), "end": iso_time(m.end),
        "effects": [{"effect": e.reference, "column": e.column or None, **e.parameters} for e in m.effects],
    }
