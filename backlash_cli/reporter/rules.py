"""`--fail-on`: which findings make the exit status 1, so that a nightly job can raise an alarm."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterable, Sequence

from ..errors import UsageError, nearest
from ..results import LoopReport, Verdict
from .words import size

Rule = Callable[[LoopReport], bool]

_SIZE = re.compile(r"d\s*(>=|>)\s*(\d+(?:\.\d*)?|\.\d+)\s*(%?)")
_NAMED: dict[str, tuple[Verdict, ...]] = {
    **{str(v): (v,) for v in (Verdict.BACKLASH, Verdict.OSCILLATING, Verdict.CANNOT_TELL, Verdict.INSUFFICIENT_DATA,
                              Verdict.ERROR)},
    "suspected": (Verdict.BACKLASH, Verdict.SUSPECTED),
    "any": (Verdict.BACKLASH, Verdict.SUSPECTED, Verdict.OSCILLATING),
}


def parse_rules(texts: Iterable[str], where: str = "--fail-on") -> list[Rule]:
    """Return the rules of the given texts; raises UsageError with the known ones for a rule that is none."""
    return [_rule(part.strip(), where) for text in texts for part in text.split(",")]


def met(rules: Sequence[Rule], reports: Iterable[LoopReport]) -> list[str]:
    """Names of the loops that meet one of the rules."""
    return [r.loop for r in reports if any(rule(r) for rule in rules)]


def _rule(text: str, where: str) -> Rule:
    known = _NAMED.get(text.lower().replace("-", "_"))
    if known is not None:
        return lambda report: report.verdict in known
    found = _SIZE.fullmatch(text.lower())
    if found is None:
        known_rules = [*_NAMED, "d>0.03", "d>3%"]
        hint = nearest(text, known_rules)
        if hint.startswith("did"):
            hint = f"{hint} Rules: {', '.join(known_rules)}"
        raise UsageError(f"no rule {text!r}", where=where, remedy=hint)
    sign, number, per_cent = found.groups()
    limit = float(number) / (100.0 if per_cent else 1.0)
    if limit > 1.0:
        raise UsageError(f"a dead band of {limit:g} spans cannot be", where=f"{where} {text}",
                         remedy=f"d is a part of the span (0.03 is 3 %); did you mean d{sign}{number}% ?")
    compare = operator.gt if sign == ">" else operator.ge
    return lambda report: (d := size(report)) is not None and compare(d, limit)
