"""How verdicts, sizes, times, errors and effects are said to a person, the same in the terminal and on a page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from ..results import Candidate, Explanation, FittedEffect, LoopReport, Region, Step, Verdict
from .json_report import iso_time
from .safe import terminal

# words, and good, warn, bad, quiet: the mark of a page and the colour of a terminal; in the order of a work list
_SAID = {
    Verdict.BACKLASH: ("backlash", "bad"),
    Verdict.SUSPECTED: ("suspected", "warn"),
    Verdict.NO_BACKLASH: ("no backlash", "good"),
    Verdict.OSCILLATING: ("oscillating", "warn"),
    Verdict.INSUFFICIENT_DATA: ("too little data", "quiet"),
    Verdict.CANNOT_TELL: ("cannot tell", "quiet"),
    Verdict.ERROR: ("not analysed", "bad"),
}
VERDICTS, MARKS = ({verdict: said[k] for verdict, said in _SAID.items()} for k in (0, 1))
_ORDER = {v: i for i, v in enumerate(VERDICTS)}
WORSE = 1.15  # share of the error over share of the time, from which a region is worth a line


def by_size(reports: Sequence[LoopReport]) -> list[LoopReport]:
    """Reports in the order of a work list: backlash and suspicion by size, then the rest by verdict and name."""
    return sorted(reports, key=lambda r: (_ORDER[r.verdict], -(size(r) or 0.0), r.loop))


def size(report: LoopReport) -> float | None:
    """Dead band to quote [span of output]: the cluster's; None where the verdict claims none."""
    if report.verdict not in (Verdict.BACKLASH, Verdict.SUSPECTED) or report.cluster is None:
        return None
    return report.cluster.d


def excluded(report: LoopReport) -> float | None:
    """Smallest dead band [span of output] that `no backlash` excludes; None where the verdict excludes none."""
    return report.limit_of_detection if report.verdict is Verdict.NO_BACKLASH else None


def in_percent(value: float, digits: int = 2) -> str:
    """A number in per cent, for a column that says so, e.g. '3.02'."""
    return f"{100 * value:.{digits}f}"


def percent(value: float | None, digits: int = 2) -> str:
    """A share of the span in per cent, e.g. '3.02 %'."""
    return "–" if value is None else f"{in_percent(value, digits)} %"


def interval(ci95: tuple[float, float]) -> str:
    """An interval in per cent, e.g. '2.85 to 3.20 %'."""
    return f"{100 * ci95[0]:.2f} to {100 * ci95[1]:.2f} %"


def change(value: float, base: float) -> str:
    """How far a value is from the one without compensator.

    >>> change(0.8, 1.0), change(3.0, 1.0), change(0.999, 1.0)
    ('-20 %', '+200 %', '0 %')
    """
    if not base > 0.0:
        return "–"
    more = round(100.0 * (value / base - 1.0))
    return f"{more:+d} %" if more else "0 %"


def counted(number: int, what: str) -> str:
    """A number of things, e.g. '1 loop', '2 loops'."""
    return f"{number} {what}{'s' * (number != 1)}"


def joined(texts: Iterable[object], between: str = ", ") -> str:
    """Texts or days one after the other."""
    return between.join(map(str, texts))


def moment(epoch: float | None) -> str:
    """A time as '2026-03-17 08:00 UTC'."""
    text = iso_time(epoch)
    return "–" if text is None else text[:16].replace("T", " ") + " UTC"


def day(epoch: float) -> str:
    """A day, e.g. '2026-03-17'."""
    return (iso_time(epoch) or "–")[:10]


def advice(report: LoopReport) -> str:
    """The compensator advice, or the first reason where there is none, in one line."""
    if report.compensator is not None:
        return f"compensate {percent(report.compensator.gain)}, {report.compensator.scheme}"
    return report.reasons[0].message if report.reasons else ""


def error_size(value: float | None) -> str:
    """An error in per cent of the measurement span with three digits, e.g. '0.812 %'."""
    return "–" if value is None or not math.isfinite(value) else f"{100 * value:.3g} %"


def share(value: float | None) -> str:
    """A share of a whole in whole per cent, e.g. '41 %'; two digits of small ones."""
    if value is None or not math.isfinite(value):
        return "–"
    if abs(value) >= 0.0995 or abs(value) < 0.0005:
        return f"{100 * value:.0f} %"
    return f"{100 * value:.2g} %"


def plain_name(effect: str) -> str:
    """The name of an effect in words: 'dead time' for dead_time."""
    return terminal(effect.replace("_", " "), 60)


def rung(step: Step) -> str:
    """What a step of the ladder added: 'baseline', '+ dead time'."""
    return "baseline" if step.added is None else f"+ {plain_name(step.added)}"


def gap_sizes(e: Explanation, pair: tuple[str, str]) -> list[float]:
    """The gap that each of these effects had where it was tried [span]."""
    tried: list[FittedEffect | Candidate] = [*e.effects, *e.candidates]
    return [p.value for x in tried if x.effect in pair for n, p in x.parameters.items()
            if n in ("d", "S") and isinstance(p.value, float)]


def effect_name(effect: str, e: Explanation) -> str:
    """The name of an accepted effect, with its twin where the record cannot tell them apart; whether it is likely."""
    twin = [b for a, b in e.look_alikes if a == effect and {a, b} == {"backlash", "stiction"}]
    likely = any(x.effect == effect and x.confidence == "likely" for x in e.effects)
    return " or ".join(plain_name(name) for name in sorted([effect, *twin])) + " (likely)" * likely


def fails(regions: Sequence[Region]) -> list[Region]:
    """The regions whose share of the error is clearly larger than their share of the time, worst first."""
    return [r for r in regions if r.expected is None or r.share >= WORSE * r.expected]
