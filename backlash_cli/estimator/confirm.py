"""PV against OP: is there a dead band between them, how wide, and which size would this record have shown?

    confirm(record) -> Confirmation | Note      a Note says why the test could not be made

The same question is asked in block means of Ti, Ti/2, Ti/4 and Ti/8 (short records Ti/16 as well): dead bands of slow
loops show in long blocks, of fast ones in short ones. The evidence is the mean of the two that show it best, each less
half of what gaps that forget would gain in its place: a load or a curved valve that is not linear gains for both.
What is excluded where there is no evidence is the matter of `exclusion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, LoopSettings, Note, Record, duration
from ..results import Confirmation
from .exclusion import excluded
from .gap_test import IMITATED, GapTest, gaps_tested, imitations, together
from .predictor import Predictor, Recording, predictor, recording_of
from .rebuild import rebuilt_output
from .width_profile import NARROWEST, TRACE, TURN, about, confirmation, peak_of, width_interval

PARTS_OF_TI = (1, 2, 4, 8, 16)  # block lengths as parts of Ti
SHORT = 6000  # blocks; the shortest blocks are tried only in records of fewer
MOST_ROWS = 6000  # of a longer record every second, third .. block is predicted, each from all that lies before it
APART = 3600.0  # seconds; process and load may have changed between recordings further apart: each is predicted by
LONG_ENOUGH = 100.0  # itself, if it is so many integral times long, and the evidence added up
SHORTEST = 10.0  # integral times: a shorter record holds no loop's behaviour
FEWEST_BLOCKS = 60  # of Ti/8: no prediction can be fitted to fewer
WIDEST = 20.0  # % of span: the widest width tried
WIDTHS, FINE = 16, 9  # how many of them, and how many between the neighbours of the best
AS_GOOD = 0.8  # of what the best imitation gains, that a gap must gain at least
LEAST_INTERVAL, IMPERFECTION = 0.08, 0.6  # of d, each way: floor, and what imitations gain as a share of the gap's gain
GAP = 20  # samples; a hole as long ends a recording


@dataclass(frozen=True)
class Asked:
    """What one block length says: predictions, gaps tested in all of them, and what the best imitation gains."""

    predictions: tuple[Predictor, ...]
    test: GapTest
    imitation: float

    @property
    def net(self) -> FloatArray:
        """Evidence (widths,) [nats] of gaps that are a possible answer of PV."""
        return self.test.answer - IMITATED * self.imitation

    @property
    def fitting(self) -> FloatArray:
        """The same (widths,) whether the answer is a possible one or not."""
        return self.test.fit - IMITATED * self.imitation


@dataclass(frozen=True)
class Study:
    """What was asked of one record. asked: by block length. length: of the record in integral times; span: of OP [%];
    rebuilt: OP was not recorded."""

    asked: tuple[Asked, ...]
    recordings: tuple[Recording, ...]
    settings: LoopSettings
    Ti: float
    interval: float
    length: float
    span: float
    rebuilt: bool

    @property
    def tests(self) -> list[tuple[GapTest, float]]:
        """The gaps tested at each block length, with what the best imitation gains."""
        return [(a.test, a.imitation) for a in self.asked]


def confirm(record: Record, settings: LoopSettings | None = None) -> Confirmation | Note:
    """Test PV against OP through a dead band; a Note says why the test could not be made.

    Ti sets the lengths of the blocks; where it is not known the memory of the control error stands in. K gives the
    sign and the possible size of PV's answer, where it is known. Where OP was not recorded it is rebuilt from SP, PV,
    K and Ti.
    """
    found = study(record, settings or record.settings)
    return found if isinstance(found, Note) else _confirmation(found)


def study(record: Record, settings: LoopSettings) -> Study | Note:
    """Ask of a record all that its confirmation is made of, or say why it cannot be asked."""
    usable = record.usable & np.isfinite(record.measurement)
    output, Ti = record.output, settings.Ti or 0.0
    if output is None:
        if not (settings.K and settings.Ti):
            return Note("no_output", "no controller output (OP) in the data, and K or Ti to rebuild it are not known")
        output = rebuilt_output(record, settings, usable & np.isfinite(record.setpoint))
    usable &= np.isfinite(output)
    if not usable.any():
        return Note("short_record", "no sample of the record can be used", {"usable_s": 0.0})
    if not Ti:
        error = np.where(np.isfinite(record.setpoint), record.setpoint, 0.0) - record.measurement
        Ti = 0.5 * memory(error[usable]) * record.interval
    recordings = _recordings(record, output, usable)
    if not recordings:
        return Note("short_record", "no stretch of the record is long enough")
    moves = np.concatenate([r.output[r.usable] for r in recordings])
    span, seconds = float(np.ptp(moves)), len(moves) * record.interval
    if span < NARROWEST * 1.5:
        return Note("output_still", f"OP covers only {span:.2g} % of its span: too little to show a dead band",
                    {"output_range": span / 100.0})
    if not any(np.ptp(r.measurement[r.usable]) > 0 for r in recordings):
        return Note("measurement_constant", "PV is the same number throughout")
    asked = _asked(recordings, span, settings.K, Ti, record.interval) if seconds >= SHORTEST * Ti else ()
    if not asked:
        return Note("short_record", f"the record holds {duration(seconds)} that can be used in one piece; at "
                    f"least {duration(SHORTEST * Ti)} are needed, ten times Ti", {"usable_s": seconds})
    return Study(asked, recordings, settings, Ti, record.interval, seconds / Ti, span, record.output is None)


def _recordings(record: Record, output: FloatArray, usable: NDArray[np.bool_]) -> tuple[Recording, ...]:
    """The samples on grids without gaps, in % of span, OP and PV less their means."""
    mean, found = 100.0 * float(output[usable].mean()), []
    for part in np.split(np.arange(len(record)), np.flatnonzero(np.diff(record.index) > GAP) + 1):
        ok = usable[part]
        if np.count_nonzero(ok) < FEWEST_BLOCKS:
            continue
        cut = slice(part[ok][0], part[ok][-1] + 1)
        found.append(recording_of(record.index[cut], output[cut], record.measurement[cut], usable[cut], scale=100.0))
        for values, level in ((found[-1].output, mean), (found[-1].measurement, found[-1].measurement.mean())):
            values -= level  # in place: long records
    return tuple(found)


def _asked(recordings: Sequence[Recording], span: float, K: float | None, Ti: float, interval: float
           ) -> tuple[Asked, ...]:
    asked, sizes = [], set()
    widths = np.geomspace(NARROWEST, max(min(WIDEST, TURN * span), 1.5 * NARROWEST), WIDTHS)
    samples = sum(len(r.output) for r in recordings)
    groups = [[recordings[0]]]
    for before, r in pairwise(recordings):
        hole = (r.begin - before.begin - len(before.output)) * interval
        if hole > APART:
            groups.append([])
        groups[-1].append(r)
    if any(sum(len(r.output) for r in group) * interval < LONG_ENOUGH * Ti for group in groups):
        groups = [list(recordings)]
    for part in PARTS_OF_TI:
        size = max(1, round(Ti / part / interval))
        if size in sizes or (part == PARTS_OF_TI[-1] and samples // size > SHORT):
            continue
        sizes.add(size)
        found = tuple(p for group in groups if (p := predictor(group, size, span, MOST_ROWS)) is not None)
        if found:
            imitated = sum(imitations(p, widths[::3], Ti, interval) for p in found)
            test = together([gaps_tested(p, widths, K, Ti, interval) for p in found])
            asked.append(Asked(found, test, float(np.max(imitated))))
    return tuple(asked)


def _confirmation(s: Study) -> Confirmation:
    from ..kernels import gap_crossings

    evidence = _evidence(s.asked)
    best, *others = sorted(s.asked, key=lambda a: float(a.net.max()), reverse=True)
    widths, j = best.test.widths, int(best.test.fit.argmax())
    fine = about(widths, j, FINE)
    closer = together([gaps_tested(p, fine, s.settings.K, s.Ti, s.interval) for p in best.predictions])
    order = np.argsort(np.append(widths, fine))
    grid, answer, deviation, share, reduction = (np.append(a, b)[order] for a, b in (
        (widths, fine), (best.test.fit, closer.fit), (best.test.deviation, closer.deviation),
        (best.test.share, closer.share), (best.test.error_reduction, closer.error_reduction)))
    d, at = peak_of(grid, answer), int(answer.argmax())
    imperfection = min(best.imitation / max(float(answer[at]), 1e-9), 1.0)
    low, high = width_interval(grid, answer, d, LEAST_INTERVAL + IMPERFECTION * imperfection)
    if others and others[0].net.max() > 0.0:  # a size that another block length does not share is known less well
        other = peak_of(widths, others[0].test.fit)
        low, high = min(low, other), max(high, other)
    details: dict[str, float | str] = {
        "evidence": evidence, "gain": float(answer[at]), "imitation": best.imitation, "share": float(share[at]),
        "share_deviation": float(deviation[at]),
        "edge": float(at in (0, len(grid) - 1)), "rows": float(sum(p.rows for p in best.predictions)),
        "block_s": best.predictions[0].size * s.interval, "output_range": s.span / 100.0,
        "crossings": float(sum(gap_crossings(r.output[r.usable], d) for r in s.recordings)),  # in automatic
        "recordings": float(len(s.recordings)), "trace": float(evidence >= TRACE),
        "sign_known": float(s.settings.K is not None), "output": "rebuilt" if s.rebuilt else "recorded",
    }
    limit = excluded(s.tests, s.length, s.span)
    return confirmation(d, (low, high), float(reduction[at]), limit, details, grid, answer)


def memory(values: FloatArray) -> float:
    """Lag [samples] at which the autocorrelation of values (samples,) has fallen to 1/e; of a loop about 2 Ti."""
    v = values[: 1 << 18] - values[: 1 << 18].mean()
    power = np.abs(np.fft.rfft(v, 2 * len(v))) ** 2
    correlation = np.fft.irfft(power)[: len(v)]
    below = np.flatnonzero(correlation < correlation[0] / np.e)
    return float(below[0]) if len(below) else float(len(v))


def _evidence(asked: Sequence[Asked]) -> float:
    """Evidence [nats] for the best width: the mean of the two block lengths that show it best. In one of them the
    answer must be a possible one; slow parts of it are known too badly to ask that of both."""
    # where an imitation does clearly better than the gap there is no evidence: so it is under a load that switches
    kept = [np.where(a.test.fit > AS_GOOD * a.imitation, np.inf, 0.0) for a in asked]
    possible = np.max([np.minimum(a.net, k) for a, k in zip(asked, kept, strict=True)], axis=0)
    fitting = [np.minimum(a.fitting, k) for a, k in zip(asked, kept, strict=True)]
    second = np.sort(fitting, axis=0)[-2] if len(asked) > 1 else 0.0
    return float(np.max(np.where(possible > 0.0, 0.5 * (possible + second), np.minimum(possible, 0.0))))
