"""Which loops of a plant are wanted, and from when on: names, wildcards, expressions, a sample; a moment or an age."""

import contextlib
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from fnmatch import fnmatchcase
from functools import cache, lru_cache
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import numpy as np

from .errors import InputError, UsageError, nearest, some
from .record import NAT, Note, fingerprint, utc_text
from .words import explained, noted

if TYPE_CHECKING:
    from .loaders.signals import Axis, LoopSeries, Series

LOOP_OPTIONS = "--loop, --loops-matching"
_UNITS = {"s": 1, "min": 60, "h": 3600, "d": 86_400, "w": 7 * 86_400}
_AGE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(s|min|h|d|w)\s*")


def sample_size(text: str, loops: int) -> int:
    """Return how many of so many loops "20" or "5%" means, a percentage rounded up. Raises UsageError."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(%?)\s*", text)
    number, percent = (float(found[1]), bool(found[2])) if found else (0.0, False)
    if not number or (number > 100.0 if percent else number % 1.0):
        raise UsageError(**explained("sample", text=text), where="--sample")
    return min(loops, math.ceil(number / 100.0 * loops - 1e-9) if percent else int(number))


@lru_cache
def check_pattern(pattern: str) -> Callable[[str], bool]:
    """Return the test of a wildcard, or of a /regular expression/, on a loop's name. Raises UsageError for neither."""
    if len(pattern) > 2 and pattern.startswith("/") and pattern.endswith("/"):
        try:
            expression = re.compile(pattern[1:-1], re.IGNORECASE)
        except (re.error, OverflowError, RecursionError) as error:
            raise UsageError(**explained("expression", text=pattern, error=error), where=LOOP_OPTIONS) from None
        return lambda name: expression.search(name) is not None
    if not pattern:
        raise UsageError(**explained("empty_pattern"), where=LOOP_OPTIONS)
    lower = pattern.lower()
    return lambda name: fnmatchcase(name.lower(), lower)


def fits(name: str, patterns: Sequence[str]) -> bool:
    """Say whether a loop is one of those named, or fits one of the patterns; all do where there are none."""
    return not patterns or any(name == pattern or check_pattern(pattern)(name) for pattern in patterns)


def choose(names: Iterable[str], only: Sequence[str] = (), matching: Sequence[str] = (), sample: str | None = None,
           seed: int = 0) -> tuple[list[str], list[Note]]:
    """Return the loops that are wanted of all `names`, in order, and what was left out and why. Raises UsageError for a
    name or patterns that nothing fits. only: each must exist. matching: one must. sample: "20" or "5%" of the rest."""
    everything = sorted(set(names))
    for pattern in only:
        if not any(fits(name, [pattern]) for name in everything):
            raise UsageError(f"no loop {pattern!r} in the data", where="--loop", remedy=nearest(pattern, everything))
    named = [name for name in everything if fits(name, only)]
    fitting = [name for name in named if fits(name, matching)]
    words = " or ".join(map(repr, matching))
    if matching and not fitting:
        raise UsageError(f"none of {len(named)} loops matches {words}", where="--loops-matching",
                         remedy=nearest(matching[0], everything))
    drawn = fitting
    if sample is not None:  # those of the smallest hash with the seed, so that a growing plant keeps them
        by_hash = sorted(fitting, key=lambda name: fingerprint(f"{seed}:{name}", 64))
        drawn = sorted(by_hash[: sample_size(sample, len(fitting))])
    notes: list[Note] = []
    if left := len(named) - len(fitting):
        notes.append(noted("not_matching", {"loops": float(left)}, of=len(named), words=words))
    if left := len(fitting) - len(drawn):
        notes.append(noted("sampled", {"loops": float(left), "seed": float(seed), "drawn": ", ".join(drawn)},
                           count=len(drawn), of=len(fitting), sample=sample, names=some(drawn)))
    return drawn, notes


def parse_since(text: str, timezone: str | None = None) -> tuple[int | None, int]:
    """Return (moment, age) in microseconds: "2026-11-01T06:00+01:00" is a moment since 1970 UTC (in `timezone` without
    offset), "3d" (s, min, h, d, w) an age, back from the last stamp; the moment is None then. Raises UsageError."""
    if age := _AGE.fullmatch(text):
        length = float(age[1]) * _UNITS[age[2]]
        if 0 < length < 1e10:
            return None, round(length * 1e6)
    else:
        with contextlib.suppress(ValueError, OverflowError):
            moment = datetime.fromisoformat(text.strip())
            if moment.tzinfo is None:
                moment = moment.replace(tzinfo=ZoneInfo(timezone) if timezone else UTC)
            return (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1), 0
    raise UsageError(**explained("since", text=text), where="--since")


def since(loops: "Mapping[str, LoopSeries]", found: "Iterable[Series]", when: str, timezone: str | None
          ) -> "tuple[dict[str, LoopSeries], list[Note], int]":
    """Take off what lies before a moment, or before an age of the last stamp of all series found. Return the loops that
    are left, what is to be said, and the moment [microseconds since 1970 UTC]. Of signals with rows of their own the
    last value before stays. Raises UsageError without times, InputError when no loop is left."""
    given, age = parse_since(when, timezone)
    newest = [np.sort(m[m != NAT])[-4:].tolist() or [NAT] for m in (a.read() for a in {s.axis for s in found})]
    last = max(max(x for x in top if x - top[0] < 2 * _UNITS["d"] * 1e6) for top in newest)  # three may stray
    if last == NAT:
        raise UsageError("the data have no times", where=f"--since {when}", remedy="leave --since out")
    moment = last - age if given is None else given

    @cache  # loops may share their rows
    def cut(axis: "Axis", keep_one: bool) -> "Axis":
        micros = axis.read()
        keep = (micros >= moment) | (micros == NAT)
        if keep_one and not keep.all():
            keep[np.argmax(np.where(keep, NAT, micros))] = True
        known = np.flatnonzero(keep & (micros != NAT))
        first = int(known[0]) if len(known) else len(keep)
        return axis.part(slice(first, None) if keep[first:].all() else np.flatnonzero(keep))

    kept: dict[str, LoopSeries] = {}
    for name, own in loops.items():
        of_pv = {item.axis for item in own.roles.get("pv", [])}  # no value of PV before the moment stays
        rest = own.changed(lambda axis, of_pv=of_pv: cut(axis, axis not in of_pv))  # type: ignore[misc]
        if not of_pv or "pv" in rest.roles:
            kept[name] = rest
    text, without = f"{utc_text(moment)} UTC", [name for name in loops if name not in kept]
    if without and not kept:
        raise InputError(**explained("nothing_since", text=text, end=utc_text(last)), where=f"--since {when}")
    left = noted("nothing_since", {"loops": float(len(without)), "names": ", ".join(without)}, of=len(loops),
                 since=text, some=some(without))
    return kept, [noted("since", {"since": text}, when=when), *[left] * bool(without)], moment
