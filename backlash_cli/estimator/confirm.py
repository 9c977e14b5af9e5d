"""PV against OP: is there a dead band between them, how wide, and which size would this record have shown?

    scanner = ConfirmationScanner(settings, interval)
    scanner.update(block) ...                    blocks of one record, cut anywhere
    scanner.finish() -> Confirmation | Note      a Note says why the test could not be made

The same question is asked in block means of Ti, Ti/2, Ti/4 and Ti/8 (short records Ti/16 as well): dead bands of slow
loops show in long blocks, of fast ones in short ones. The evidence is the mean of the two that show it best, each less
half of what gaps that forget would gain in its place: a load or a curved valve that is not linear gains for both.
What is excluded where there is no evidence is the matter of `exclusion`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, LoopSettings, Note, Record, duration
from ..results import Confirmation
from .exclusion import excluded
from .gap_test import IMITATED, GapTest, gaps_tested, imitations, together
from .predictor import Predictor, Recording, predictor, recording_of
from .rebuild import OutputRebuilder
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
MOST_SAMPLES = 1 << 22  # kept of one loop; of a longer record the last ones


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


class ConfirmationScanner:
    """Takes the blocks of one loop's record and tests PV against OP through a dead band at the end.

    Ti sets the lengths of the blocks; where it is not known the memory of the control error stands in. K gives the
    sign and the possible size of PV's answer, where it is known. Where OP was not recorded it is rebuilt from SP, PV,
    K and Ti.
    """

    def __init__(self, settings: LoopSettings, interval: float) -> None:
        self.settings, self.interval = settings, interval
        self._Ti = settings.Ti or 0.0
        self._blocks: deque[tuple[NDArray[Any], ...]] = deque()
        self._samples = 0
        self._rebuilder: OutputRebuilder | None = None
        self._left_out = 0
        self.tests: list[tuple[GapTest, float]] = []  # after finish: of each block length, with its imitation's gain
        self.length = self.span = 0.0  # of the record in integral times; of OP [%]

    def update(self, block: Record) -> None:
        """Take the next block; its index goes on where the last one ended, or later."""
        if not len(block):
            return
        output = block.output
        usable = block.usable & np.isfinite(block.measurement)
        if output is None:
            if not (self.settings.K and self.settings.Ti):
                return
            if self._rebuilder is None:
                self._rebuilder = OutputRebuilder(self.settings, self.interval)
            output = self._rebuilder.update(block, usable & np.isfinite(block.setpoint))
        self._blocks.append((block.index, block.setpoint, block.measurement, output, usable & np.isfinite(output)))
        self._samples += len(block)
        while self._samples - len(self._blocks[0][0]) > MOST_SAMPLES:
            gone = len(self._blocks.popleft()[0])
            self._samples -= gone
            self._left_out += gone

    def finish(self) -> Confirmation | Note:
        """Return what the record says about a dead band, or why it says nothing."""
        recordings = self._recordings()
        if isinstance(recordings, Note):
            return recordings
        usable = np.concatenate([r.output[r.usable] for r in recordings])
        span = float(np.ptp(usable))
        if span < NARROWEST * 1.5:
            return Note("output_still", f"OP covers only {span:.2g} % of its span: too little to show a dead band",
                        {"output_range": span / 100.0})
        if not any(np.ptp(r.measurement[r.usable]) > 0 for r in recordings):
            return Note("measurement_constant", "PV is the same number throughout")
        seconds = len(usable) * self.interval
        asked = self._asked(recordings, span) if seconds >= SHORTEST * self._Ti else []
        if not asked:
            return Note("short_record", f"the record holds {duration(seconds)} that can be used in one piece; at "
                        f"least {duration(SHORTEST * self._Ti)} are needed, ten times Ti", {"usable_s": seconds})
        self.tests, self.length, self.span = [(a.test, a.imitation) for a in asked], seconds / self._Ti, span
        return self._confirmation(recordings, asked)

    def _recordings(self) -> list[Recording] | Note:
        """The samples on grids without gaps, in % of span, OP and PV less their means."""
        if not self._blocks:
            return Note("no_output", "no controller output (OP) in the data, and K or Ti to rebuild it are not known")
        index, setpoint, measured, output, usable = (np.concatenate(c) for c in zip(*self._blocks, strict=True))
        if not usable.any():
            return Note("short_record", "no sample of the record can be used", {"usable_s": 0.0})
        if not self._Ti:
            error = np.where(np.isfinite(setpoint), setpoint, 0.0) - measured
            self._Ti = 0.5 * memory(error[usable]) * self.interval
        mean = 100.0 * float(output[usable].mean())
        found = []
        for part in np.split(np.arange(len(index)), np.flatnonzero(np.diff(index) > GAP) + 1):
            ok = usable[part]
            if np.count_nonzero(ok) < FEWEST_BLOCKS:
                continue
            first, last = part[ok][0], part[ok][-1] + 1
            cut = slice(first, last)
            found.append(recording_of(index[cut], output[cut], measured[cut], usable[cut], scale=100.0))
            for values, level in ((found[-1].output, mean), (found[-1].measurement, found[-1].measurement.mean())):
                values -= level  # in place: long records
        return found or Note("short_record", "no stretch of the record is long enough")

    def _asked(self, recordings: list[Recording], span: float) -> list[Asked]:
        Ti, asked, sizes = self._Ti, [], set()
        widths = np.geomspace(NARROWEST, max(min(WIDEST, TURN * span), 1.5 * NARROWEST), WIDTHS)
        samples = sum(len(r.output) for r in recordings)
        groups = [[recordings[0]]]
        for before, r in pairwise(recordings):
            hole = (r.begin - before.begin - len(before.output)) * self.interval
            if hole > APART:
                groups.append([])
            groups[-1].append(r)
        if any(sum(len(r.output) for r in group) * self.interval < LONG_ENOUGH * Ti for group in groups):
            groups = [recordings]
        for part in PARTS_OF_TI:
            size = max(1, round(Ti / part / self.interval))
            if size in sizes or (part == PARTS_OF_TI[-1] and samples // size > SHORT):
                continue
            sizes.add(size)
            found = tuple(p for group in groups if (p := predictor(group, size, span, MOST_ROWS)) is not None)
            if found:
                imitated = sum(imitations(p, widths[::3], Ti, self.interval) for p in found)
                asked.append(Asked(found, self._test(found, widths), float(np.max(imitated))))
        return asked

    def _test(self, predictions: Sequence[Predictor], widths: FloatArray) -> GapTest:
        return together([gaps_tested(p, widths, self.settings.K, self._Ti, self.interval) for p in predictions])

    def _confirmation(self, recordings: list[Recording], asked: list[Asked]) -> Confirmation:
        from ..kernels import gap_crossings

        evidence = _evidence(asked)
        best, *others = sorted(asked, key=lambda a: float(a.net.max()), reverse=True)
        widths, j = best.test.widths, int(best.test.fit.argmax())
        fine = about(widths, j, FINE)
        closer = self._test(best.predictions, fine)
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
        limit = excluded(self.tests, self.length, self.span)
        crossings = sum(gap_crossings(r.output, d) for r in recordings)
        details: dict[str, float | str] = {
            "evidence": evidence, "gain": float(answer[at]), "imitation": best.imitation, "share": float(share[at]),
            "share_deviation": float(deviation[at]),
            "edge": float(at in (0, len(grid) - 1)), "rows": float(sum(p.rows for p in best.predictions)),
            "block_s": best.predictions[0].size * self.interval, "output_range": self.span / 100.0,
            "crossings": float(crossings), "recordings": float(len(recordings)),
            "trace": float(evidence >= TRACE),
            "left_out": float(self._left_out), "sign_known": float(self.settings.K is not None),
            "output": "rebuilt" if self._rebuilder else "recorded",
        }
        return confirmation(d, (low, high), float(reduction[at]), limit, details, grid, answer)


def confirm(record: Record, settings: LoopSettings | None = None) -> Confirmation | Note:
    """Test one record for a dead band between OP and PV; the same as one update of a ConfirmationScanner."""
    scanner = ConfirmationScanner(settings or record.settings, record.interval)
    scanner.update(record)
    return scanner.finish()


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
