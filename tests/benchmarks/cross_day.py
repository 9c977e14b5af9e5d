"""Does a model that was fitted to one day hold on another? Real recordings beside the project, and simulated pairs.

    python -m tests.benchmarks.cross_day                 real tags with several recordings (skipped where not there)
    python -m tests.benchmarks.cross_day --simulated 30  pairs of days of the same simulated loop

For each pair `explain` fits the first day and `compare` takes the kept model to the second: its numbers stay, only what
belongs to a day (offset, start) is matched. Beside it stands the plain model fitted to the first day and kept as well,
and the plain model fitted to the second day itself, which is a harder rival.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from backlash_cli import read
from backlash_cli.errors import BacklashError
from backlash_cli.model import compare, explain
from backlash_cli.record import Record
from backlash_cli.results import Comparison, Explanation
from tests.shared_data import shared_root

from .two_days import two_days


@dataclass(frozen=True)
class Row:
    """One pair: hold-out errors [PV span] of the plain and the explained model on both days."""

    name: str
    effects: tuple[str, ...]
    own_plain: float
    own: float
    kept_plain: float
    refitted_plain: float
    other: float
    floor: float
    said: tuple[str, ...]

    @property
    def falls(self) -> bool:
        """True when the explained model beats the plain one on the other day, both kept as they were."""
        return self.other < self.kept_plain


def row(name: str, found: Explanation, there: Record) -> Row:
    """Take the model of an explanation, and the plain model fitted to the same day, to another day."""
    assert found.model is not None
    other = compare(there, found.model)
    first = found.baseline.parameters
    plain = replace(found.model, effects=(), rmse_holdout=found.baseline.rmse_holdout,
                    **{k: float(first[k].value) for k in ("Kp", "tau", "theta", "offset") if k in first})
    kept = compare(there, plain)
    return Row(name, tuple(e.effect for e in found.effects), found.baseline.rmse_holdout, found.rmse_holdout,
               kept.fitness.rmse_holdout, other.baseline.rmse_holdout, other.fitness.rmse_holdout, other.noise_floor,
               codes(other))


def codes(found: Comparison) -> tuple[str, ...]:
    """Codes of what `compare` says about the record and the model, and why the model does not hold."""
    return tuple(note.code for note in (*found.warnings, *found.reasons) if not note.code.startswith("guessed"))


def recordings(folder: Path) -> dict[str, list[Record]]:
    """All recordings of each tag, in time order."""
    found: dict[str, list[Record]] = defaultdict(list)
    for path in sorted(folder.glob("*.csv")):
        record = next(iter(read(str(path))))
        found[record.loop].append(record)
    return {tag: sorted(records, key=lambda r: r.start) for tag, records in found.items()}


def real(folder: Path) -> Iterator[Row]:
    """Yield each recording of a tag beside the next one of it."""
    for tag, records in recordings(folder).items():
        for here, there in pairwise(records):
            days = " ".join(str(np.datetime64(int(r.start), "s"))[2:10] for r in (here, there))
            try:
                yield row(f"{tag} {days}", explain(here), there)
            except BacklashError as error:
                print(f"{tag} {days}: {error}")


def simulated(count: int, first: int) -> Iterator[Row]:
    """Yield pairs of days of the same loop, drawn at random."""
    for seed in range(first, first + count):
        pair = two_days(seed)
        yield row(f"{seed} {pair.kind}", explain(pair.monday), pair.tuesday)


def table(title: str, rows: Iterator[Row]) -> None:
    """Print the pairs and how often the error falls."""
    print(f"{title}: hold-out errors in % of span")
    print(f"{'pair':36s}{'own day':>16s}{'other day: plain kept, refitted, explained':>44s}  effects")
    kept: list[Row] = []
    for r in rows:
        kept.append(r)
        print(f"{r.name:36s}{100 * r.own_plain:8.3f}{100 * r.own:8.3f}{100 * r.kept_plain:20.3f}"
              f"{100 * r.refitted_plain:12.3f}{100 * r.other:12.3f}  {', '.join(r.effects) or 'nothing'} "
              f"{'' if r.falls or not r.effects else '(does not fall)'} {', '.join(r.said)}", flush=True)
    lasting = [r for r in kept if r.effects]
    for words, chosen in (
        ("with an effect", lasting),
        ("with friction", [r for r in lasting if {"backlash", "stiction"} & set(r.effects)]),
    ):
        if not chosen:
            continue
        gone = [1.0 - (r.other / r.kept_plain) ** 2 for r in chosen]
        print(f"{words}: error falls on the other day in {sum(r.falls for r in chosen)} of {len(chosen)}; below a "
              f"plain model fitted to that day in {sum(r.other < r.refitted_plain for r in chosen)}; median share "
              f"of the squared error gone {np.median(gone):.2f}")


def main() -> None:
    """Read the options and print the table."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--simulated", type=int, default=0, metavar="N")
    ask.add_argument("--first", type=int, default=0)
    given = ask.parse_args()
    if given.simulated:
        table("simulated pairs", simulated(given.simulated, given.first))
        return
    folder = shared_root() / "data" / "plant"
    if not folder.exists():
        print("no real recordings beside this checkout (set BACKLASH_SHARED); try --simulated 30")
        return
    table("real recordings", real(folder))


if __name__ == "__main__":
    main()
