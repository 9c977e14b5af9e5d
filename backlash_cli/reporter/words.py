"""How verdicts, sizes, times and shares are said to a person, the same in the terminal and on a page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..results import Compensator, LoopReport, Verdict
from .json_report import iso_time

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


def duration(seconds: float) -> str:
    """A duration in the unit that suits it, e.g. '5.3 h'."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.3g} s"


def refused(report: LoopReport) -> str:
    """Why half periods were not used, and how many for each reason."""
    return ", ".join(f"{n} {code}" for code, n in report.rejected.items())


def advice(report: LoopReport) -> str:
    """The compensator advice, or the first reason where there is none, in one line."""
    if report.compensator is not None:
        return f"compensate {percent(report.compensator.gain)}, {report.compensator.scheme}"
    return report.reasons[0].message if report.reasons else ""


def compensator_words(found: Compensator) -> list[str]:
    """The advice in full, and whose decision it is."""
    return [f"Compensator gain {percent(found.gain)} of the output span, scheme {found.scheme}. {found.reason}",
            "This is advice to a person; nothing is written to the control system."]
