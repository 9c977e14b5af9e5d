"""Records and reports as short nested values that a person can compare line by line."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from backlash_cli import ScanOptions, scan_files
from backlash_cli.loaders import Plant, read
from backlash_cli.record import Note, Record
from backlash_cli.results import LoopReport
from backlash_cli.scanning import scan
from tests.benchmarks.random_loops import draw

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
FILES = ("plant.csv", "plant.parquet", "plant_long.csv.gz")
CHAOTIC = 56  # so near its stability limit that the processor's last digit decides its course
SIMULATED = [seed for seed in range(61) if seed != CHAOTIC]
RELATIVE, ABSOLUTE = 1e-6, 1e-9  # numbers: only rounding may differ


def rounded(value: float | None) -> float | None:
    """A number with eight digits; None where it is none."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.8g}")


def of_record(record: Record) -> dict[str, Any]:
    """What stands in the record of one loop: grid, signals, settings, states, codes of the notes."""
    signals = {"SP": record.setpoint, "PV": record.measurement, "OP": record.output, **record.disturbances}
    settings = record.settings
    states = np.bincount(record.state, minlength=7)
    return {
        "start": rounded(record.start), "interval": record.interval, "samples": len(record),
        "last_index": int(record.index[-1]), "states": states.tolist(),
        **{name: _of_signal(values) for name, values in sorted(signals.items()) if values is not None},
        "settings": {name: getattr(settings, name) if not isinstance(getattr(settings, name), float)
                     else rounded(getattr(settings, name)) for name in ("K", "Ti", "Td", "Tf", "Kp", "theta")},
        "pv_range": list(settings.pv_range), "op_range": list(settings.op_range), "source": dict(settings.source),
        "notes": codes(record.notes),
    }


def _of_signal(values: np.ndarray) -> dict[str, Any]:
    known = values[np.isfinite(values)]
    if not len(known):
        return {"finite": 0}
    return {"finite": len(known), "mean": rounded(known.mean()), "std": rounded(known.std()),
            "first": rounded(known[0]), "last": rounded(known[-1])}


def of_plant(plant: Plant) -> dict[str, Any]:
    """All loops of a plant, what was said of it, and what could not be read."""
    return {"loops": {record.loop: of_record(record) for record in plant}, "warnings": codes(plant.warnings),
            "failures": codes(plant.failures)}


def of_report(report: LoopReport) -> dict[str, Any]:
    """What a report concludes; estimates as their number and middle."""
    accepted = [one.d for one in report.estimates if one.accepted]
    cluster, confirmed, advice = report.cluster, report.confirmation, report.compensator
    return {
        "verdict": str(report.verdict.value), "reasons": codes(report.reasons), "warnings": codes(report.warnings),
        "confidence": rounded(report.confidence), "samples": report.samples, "half_periods": report.half_periods,
        "detections": report.detections, "rejected": dict(sorted(report.rejected.items())),
        "middle": rounded(float(np.median(accepted))) if accepted else None,
        "cluster": None if cluster is None else [rounded(cluster.d), *map(rounded, cluster.ci95), cluster.n],
        "confirmation": None if confirmed is None else [rounded(confirmed.d), *map(rounded, confirmed.ci95)],
        "compensator": None if advice is None else [advice.scheme, rounded(advice.gain)],
    }


def codes(notes: Iterable[Note]) -> list[str]:
    """The codes of notes, each once, in order."""
    return sorted({note.code for note in notes})


def readings() -> dict[str, Any]:
    """Readings of the sample files."""
    return {name: of_plant(read(SAMPLES / name, loops=_sidecar(name))) for name in FILES}


def reports() -> dict[str, Any]:
    """Reports of the sample files and of loops drawn at random."""
    found = {}
    for name in FILES:
        result = scan_files(SAMPLES / name, loops=_sidecar(name), jobs=1)
        found |= {f"{name} {report.loop}": of_report(report) for report in result.loops}
    for seed in SIMULATED:
        found[f"simulated {seed}"] = of_report(scan(draw(seed, samples=4000).record, ScanOptions()))
    return found


def _sidecar(name: str) -> Path:
    return SAMPLES / ("plant_long.loops.toml" if "long" in name else "plant.loops.toml")


def differences(old: Any, new: Any, where: str = "") -> Iterator[str]:
    """Say in words where two digests differ by more than rounding."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in {**old, **new}:
            place = f"{where} / {key}" if where else str(key)
            if key not in new:
                yield f"{place}: is gone"
            elif key not in old:
                yield f"{place}: is new"
            else:
                yield from differences(old[key], new[key], place)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for k, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from differences(a, b, f"{where} [{k}]")
    elif isinstance(old, (int, float)) and isinstance(new, (int, float)):
        if not math.isclose(old, new, rel_tol=RELATIVE, abs_tol=ABSOLUTE):
            yield f"{where}: was {old}, is {new}"
    elif old != new:
        yield f"{where}: was {old}, is {new}"
