"""Which loops of a plant are computed: by name, by pattern, or a sample that is the same every time.

What is left out is counted and said. The choice depends on the names alone, not on the order of files, the engine or
the machine.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from ..errors import UsageError, nearest
from ..record import Note

SHOWN = 12  # names written out in a message; all of them stand in its values


@dataclass(frozen=True)
class Share:
    """The part of a plant that one worker computes, settled before by a plan of the whole.

    loops: exact names. renamed: names in the data -> names of these loops, where they differ. since: moment
    [microseconds since 1970 UTC] from which on data count; age: it was given as an age.
    """

    loops: tuple[str, ...]
    renamed: tuple[tuple[str, str], ...] = ()
    since: int | None = None
    age: bool = False


@dataclass(frozen=True)
class Choice:
    """names: the loops to compute, in order. notes: what was left out, and why."""

    names: tuple[str, ...]
    notes: tuple[Note, ...] = ()


def choose(names: Iterable[str], only: Sequence[str] = (), matching: Sequence[str] = (), sample: str | None = None,
           seed: int = 0) -> Choice:
    """Return the loops that are wanted of all `names`.

    only: names or wildcards, each of which must exist. matching: patterns (`check_pattern`), of which one must exist.
    sample: "20" or "5%" of what is left, drawn by `seed`. Raises UsageError for a name or patterns that nothing fits.
    """
    everything = sorted(set(names))
    chosen = _named(everything, only)
    notes: list[Note] = []
    if matching:
        tests = [check_pattern(pattern) for pattern in matching]
        fitting = [name for name in chosen if any(test(name) for test in tests)]
        words = " or ".join(repr(pattern) for pattern in matching)
        if not fitting:
            raise UsageError(f"none of {len(chosen)} loops matches {words}", where="--loops-matching",
                             remedy=nearest(matching[0], everything))
        if left := len(chosen) - len(fitting):
            text = f"{left} of {len(chosen)} loops do not match {words} and were not computed"
            notes.append(Note("not_matching", text, {"loops": float(left)}))
        chosen = fitting
    if sample is not None:
        drawn = draw(chosen, sample_size(sample, len(chosen)), seed)
        if left := len(chosen) - len(drawn):
            text = (f"{len(drawn)} of {len(chosen)} loops were drawn (--sample {sample}, seed {seed}): {shown(drawn)}; "
                    f"{left} were not computed")
            notes.append(Note("sampled", text, {"loops": float(left), "seed": float(seed), "drawn": ", ".join(drawn)}))
        chosen = drawn
    return Choice(tuple(chosen), tuple(notes))


def _named(names: list[str], only: Sequence[str]) -> list[str]:
    if not only:
        return names
    chosen: set[str] = set()
    for pattern in only:
        hits = [name for name in names if name == pattern or fnmatchcase(name.lower(), pattern.lower())]
        if not hits:
            raise UsageError(f"no loop {pattern!r} in the data", where="--loop", remedy=nearest(pattern, names))
        chosen.update(hits)
    return sorted(chosen)


def draw(names: Sequence[str], count: int, seed: int = 0) -> list[str]:
    """Return `count` of the names, in order: those whose hash with the seed is smallest.

    So a plant that grows by a few loops keeps nearly the same sample, and every night looks at the same loops.
    """
    def place(name: str) -> bytes:
        return hashlib.sha256(f"{seed}:{name}".encode("utf-8", "backslashreplace")).digest()

    return sorted(sorted(names, key=place)[:count])


def sample_size(text: str, loops: int) -> int:
    """Return how many of so many loops "20" or "5%" means, a percentage rounded up. Raises UsageError."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(%?)\s*", text)
    number = float(found[1]) if found else 0.0
    percent = bool(found and found[2])
    if not number or (percent and number > 100.0) or (not percent and number % 1.0):
        raise UsageError(f"{text!r} is no size of a sample", where="--sample",
                         remedy="give a number of loops such as 20, or a share such as 5%")
    return min(loops, math.ceil(number / 100.0 * loops - 1e-9) if percent else int(number))


def check_pattern(pattern: str) -> Callable[[str], bool]:
    """Return the test of a pattern on a loop's name, in upper or lower case: wildcards over the whole name
    (`FIC*`, `AREA?.*`), or a regular expression between slashes, found anywhere in it (`/^FIC1[0-4]/`).

    Raises UsageError for a regular expression that is none.
    """
    if len(pattern) > 2 and pattern.startswith("/") and pattern.endswith("/"):
        try:
            expression = re.compile(pattern[1:-1], re.IGNORECASE)
        except (re.error, OverflowError, RecursionError) as error:
            raise UsageError(f"{pattern!r} is no regular expression: {error}", where="--loops-matching",
                             remedy="for example '/^FIC1[0-4]/', or wildcards without slashes: 'FIC*'") from None
        return lambda name: expression.search(name) is not None
    if not pattern:
        raise UsageError("the pattern is empty", where="--loops-matching", remedy="for example 'FIC*'")
    lower = pattern.lower()
    return lambda name: fnmatchcase(name.lower(), lower)


def shown(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(name[:40] for name in names[:SHOWN]) + more
