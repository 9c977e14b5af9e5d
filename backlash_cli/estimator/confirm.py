"""Confirmation from OP: is there a dead band between OP and PV, how wide, and what could have been seen?

    scanner = ConfirmationScanner(settings, interval)
    scanner.update(block) ...                    blocks of one record, cut anywhere
    scanner.finish() -> Confirmation | Note      a Note says why the test could not be made

Kept between blocks are means over about a quarter of Ti, of PV and of OP through a fixed grid of dead bands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..record import FloatArray, IntArray, LoopSettings, Note, Record
from ..results import Confirmation
from .criteria import MOTION
from .decimate import WIDTHS, BlockMeans
from .evidence import Evidence, Rows, weigh
from .periodic import periodic_load
from .rebuild import OutputRebuilder

BLOCKS_PER_TI = 4.0  # sensitivity is that of 3 and 6; 6 makes fewer false calls on square loads, in twice the time
FEWEST_ROWS = 150
MOST_ROWS = 3000  # of a longer record the stretches with the most motion of OP are used
STRETCH = 250
BRIDGE = 2  # blocks missing in a row that are bridged by a straight line
LAG_ROWS = 1.0  # where the search for the lag of the process begins: about Ti / 4
SPREAD_FLOOR = 0.06  # of d: what the model of the process costs, whatever the noise
SPREAD_PER_STEP = 0.005  # of d: what each load step found adds to that
SPREAD_OF_LINE = 0.06  # of d: the same for a load that swings with one period
WIDENING = 2.2  # half intervals of the likelihood come out this much too short on simulated loops
LEAST_TURN = 1.02  # the range of OP over the largest dead band that is tried


@dataclass(frozen=True)
class _Kept:
    at: IntArray
    means: FloatArray  # (rows, 2 + widths)


class ConfirmationScanner:
    """Takes the blocks of one loop's record and tests PV against OP through a dead band at the end.

    settings must hold K and Ti. Where OP was not recorded it is rebuilt from SP, PV, K and Ti.
    """

    def __init__(self, settings: LoopSettings, interval: float) -> None:
        if not settings.K or not settings.Ti:
            raise ValueError("the test of PV against OP needs K and Ti")
        self.settings, self.interval = settings, interval
        self.size = max(1, round(settings.Ti / (BLOCKS_PER_TI * interval)))
        self._blocks = BlockMeans(self.size)
        self._rebuilder: OutputRebuilder | None = None
        self._low, self._high = np.inf, -np.inf
        self._setpoint: float | None = None
        self._setpoint_moves = False

    def update(self, block: Record) -> None:
        """Take the next block; its index goes on where the last one ended, or later."""
        if not len(block):
            return
        usable = block.usable & np.isfinite(block.measurement)
        if block.output is None:
            usable &= np.isfinite(block.setpoint)
            if self._rebuilder is None:
                self._rebuilder = OutputRebuilder(self.settings, self.interval)
            output = self._rebuilder.update(block, usable)
        else:
            output = block.output
            usable &= np.isfinite(output)
        setpoint = block.setpoint[block.usable & np.isfinite(block.setpoint)]
        if len(setpoint):
            self._setpoint = float(setpoint[0]) if self._setpoint is None else self._setpoint
            self._setpoint_moves |= bool(np.any(setpoint != self._setpoint))
        moved = output[usable]
        if len(moved):
            self._low, self._high = min(self._low, float(moved.min())), max(self._high, float(moved.max()))
        self._blocks.update(block.index, block.measurement, output, usable)

    def rows(self) -> Rows | Note:
        """Return the rows of the test, or why there are none."""
        at, means = self._blocks.rows()
        kept = _most_active(_bridged(_Kept(at, means)), MOST_ROWS)
        if len(kept.at) < FEWEST_ROWS:
            return Note("short_record", f"only {len(kept.at)} blocks of {self.size * self.interval:g} s can be used, "
                        f"{FEWEST_ROWS} are needed", {"blocks": len(kept.at)})
        first = np.diff(kept.at, prepend=kept.at[0] - 2) != 1
        start = np.maximum.accumulate(np.where(first, np.arange(len(first)), 0))
        level = kept.means - kept.means[start]
        sign = np.sign(float(self.settings.K or 1.0))
        span = self._high - self._low
        widths = WIDTHS[span >= WIDTHS * LEAST_TURN]
        if len(widths) < 2:
            return Note("output_still", f"OP covers only {100 * max(span, 0.0):.2g} % of its span: too little to show "
                        "a dead band", {"output_range": max(span, 0.0)})
        if not np.ptp(level[:, 0]) > 0:
            return Note("measurement_constant", "PV is the same number throughout")
        assert self.settings.Ti is not None
        lag = LAG_ROWS * self.settings.Ti / (BLOCKS_PER_TI * self.size * self.interval)
        x = np.ascontiguousarray(level[:, 1 : 2 + len(widths)].T)
        y = np.ascontiguousarray(sign * level[:, 0])
        line = np.empty((0, len(y))) if self._setpoint_moves else periodic_load(y, kept.at)
        return Rows(y, x, widths, first, lag, line)

    def finish(self) -> Confirmation | Note:
        """Return what the record says about a dead band, or why it says nothing."""
        rows = self.rows()
        if isinstance(rows, Note):
            return rows
        return self._confirmation(weigh(rows), bool(len(rows.line)))

    def _confirmation(self, e: Evidence, swings: bool) -> Confirmation:
        low, high = widened(e.d, e.interval, e.steps, swings)
        span = self._high - self._low
        details: dict[str, float | str] = {
            "evidence": e.gain, "half": e.half, "mirror": e.mirror, "responds": e.responds, "steps": float(e.steps),
            "rows": float(e.rows), "block_s": self.size * self.interval, "output_range": span, "noise": e.noise,
            "gain_to_pv": e.gain_to_pv, "load_swings": float(swings),
            "output": "rebuilt" if self._rebuilder else "recorded",
        }
        return Confirmation(e.d, (low, high), e.error_reduction, 2.0 * e.gain - float(np.log(max(e.rows, 1))),
                            limit_of_detection(e, span), details, e.profile)


def confirm(record: Record, settings: LoopSettings | None = None) -> Confirmation | Note:
    """Test one record for a dead band between OP and PV; the same as one update of a ConfirmationScanner."""
    scanner = ConfirmationScanner(settings or record.settings, record.interval)
    scanner.update(record)
    return scanner.finish()


def widened(d: float, interval: tuple[float, float], steps: int, swings: bool) -> tuple[float, float]:
    """Return the 95 % interval of d: the likelihood interval, widened to hold the truth in 96 % of simulated loops."""
    floor = (SPREAD_FLOOR + SPREAD_PER_STEP * steps + SPREAD_OF_LINE * swings) * d
    low = d - float(np.hypot(WIDENING * (d - interval[0]), floor))
    high = d + float(np.hypot(WIDENING * (interval[1] - d), floor))
    return max(low, 0.0), high


def limit_of_detection(e: Evidence, span: float) -> float:
    """Return the smallest dead band [span of output] that this record excludes or would have shown.

    From the profile: the smallest width from which on every tried width explains PV clearly worse than none; not
    less than what the range of OP allows.
    """
    excluded = [d for d, v in e.profile if v > -DROP_FOR_LIMIT]
    wide = max(excluded) if excluded else e.profile[0][0]
    larger = [d for d, _ in e.profile if d > wide]
    return min(larger) if larger else max(wide, span / MOTION)


DROP_FOR_LIMIT = 6.0  # nats: at the true width the evidence is this negative in about one loop of ten


def _bridged(kept: _Kept) -> _Kept:
    if len(kept.at) < 2:
        return kept
    steps = np.diff(kept.at)
    holes = np.flatnonzero((steps > 1) & (steps <= 1 + BRIDGE))
    if not len(holes):
        return kept
    at = np.concatenate([kept.at, *(np.arange(kept.at[i] + 1, kept.at[i + 1]) for i in holes)])
    at.sort()
    means = np.column_stack([np.interp(at, kept.at, column) for column in kept.means.T])
    return _Kept(at, means)


def _most_active(kept: _Kept, most: int) -> _Kept:
    """Keep at most `most` rows: whole stretches in which OP travels most."""
    if len(kept.at) <= most:
        return kept
    stretch = (kept.at // STRETCH) - kept.at[0] // STRETCH
    travel = np.abs(np.diff(kept.means[:, 1], prepend=kept.means[0, 1]))
    score = np.bincount(stretch, travel)
    rows = np.bincount(stretch)
    order = np.argsort(-score, kind="stable")
    chosen = order[np.cumsum(rows[order]) <= most]
    use = np.isin(stretch, chosen)
    return _Kept(kept.at[use], kept.means[use])
