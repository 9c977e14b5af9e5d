"""Confirmation from OP: is there a dead band between OP and PV, how wide, and what could have been seen?

    scanner = ConfirmationScanner(settings, interval)
    scanner.update(block) ...                    blocks of one record, cut anywhere
    scanner.finish() -> Confirmation | Note      a Note says why the test could not be made

Kept between blocks are means over about a quarter of Ti, of PV and of OP through a fixed grid of dead bands.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, LoopSettings, Note, Record
from ..results import Confirmation
from .criteria import EVIDENCE, MOTION
from .decimate import STEM, WIDTHS, BlockMeans
from .evidence import Evidence, weigh
from .light import weigh_lightly
from .periodic import periodic_load
from .rebuild import OutputRebuilder
from .row_loops import from_start
from .rows import Rows, beginning, counted
from .stem import weigh_with_stem
from .switching_load import switching_load, with_switching_load
from .whitening import WARM_UP

BLOCKS_PER_TI = 4.0  # sensitivity is that of 3 and 6; 6 makes fewer false calls on square loads, in twice the time
FEWEST_ROWS = 150
MOST_ROWS = 2000  # of a longer record the stretches with the most motion of OP are used
PLENTY = 4 * MOST_ROWS  # rows of a record that is very long
LAG_ROWS = 1.0  # where the search for the lag of the process begins: about Ti / 4
SPREAD_FLOOR = 0.06  # of d: what the model of the process costs, whatever the noise
SPREAD_PER_STEP = 0.005  # of d: what each load step found adds to that
SPREAD_OF_LINE = 0.06  # of d: the same for a load that swings with one period
SPREAD_OF_SWITCHING = 0.2  # of d: the same for a load that switches to and fro
SPREAD_OF_START = 0.15  # of d: where the stem stood at the start of recordings that cover the gap late or never
WIDENING = 1.6  # half intervals of the likelihood come out this much too short on simulated loops
LEAST_NOISE = 0.02  # of the deviation of PV: the model of the process is not better than that
MOST_ADDED = 0.0005  # span: and where PV moves far, this is enough
LEAST_TURN = 1.02  # the range of OP over the largest dead band that is tried


class ConfirmationScanner:
    """Takes the blocks of one loop's record and tests PV against OP through a dead band at the end.

    settings must hold K and Ti. Where OP was not recorded it is rebuilt from SP, PV, K and Ti.
    """

    def __init__(self, settings: LoopSettings, interval: float) -> None:
        if not settings.K or not settings.Ti:
            raise ValueError("the test of PV against OP needs K and Ti")
        self.settings, self.interval = settings, interval
        self.size = max(1, round(settings.Ti / (BLOCKS_PER_TI * interval)))
        self._blocks = BlockMeans(self.size, MOST_ROWS)
        self._rebuilder: OutputRebuilder | None = None

    def update(self, block: Record) -> None:
        """Take the next block; its index goes on where the last one ended, or later."""
        if not len(block):
            return
        output = block.output
        if output is None:
            if self._rebuilder is None:
                self._rebuilder = OutputRebuilder(self.settings, self.interval)
            usable = block.usable & np.isfinite(block.measurement) & np.isfinite(block.setpoint)
            output = self._rebuilder.update(block, usable)
        self._blocks.update(block.index, block.setpoint, block.measurement, output, block.state)

    def rows(self) -> Rows | Note:
        """Return the rows of the test, or why there are none."""
        at, means = self._blocks.rows()
        first = np.diff(at, prepend=at[:1] - 2) != 1
        useful = int(counted(first).sum()) + WARM_UP  # a record in one piece has to settle once
        if min(len(at), useful) < FEWEST_ROWS:
            usable, needed = (n * self.size * self.interval for n in (min(len(at), useful), FEWEST_ROWS))
            return Note("short_record", f"the record holds {_in_words(usable)} that can be used; {_in_words(needed)} "
                        "are needed", {"usable_s": usable, "needed_s": needed})
        span = self._covered(means)
        widths = WIDTHS[span >= WIDTHS * LEAST_TURN]
        if len(widths) < 2:
            return Note("output_still", f"OP covers only {100 * max(span, 0.0):.2g} % of its span: too little to show "
                        "a dead band", {"output_range": max(span, 0.0)})
        if not np.ptp(means[:, 0]) > 0:
            return Note("measurement_constant", "PV is the same number throughout")
        line = np.empty((0, len(at))) if self._blocks.setpoint_moves else periodic_load(means[:, 0], at)
        level = from_start(np.ascontiguousarray(means[:, : 2 + len(widths)].T), np.arange(len(at)), first)
        assert self.settings.Ti is not None
        lag = LAG_ROWS * self.settings.Ti / (BLOCKS_PER_TI * self.size * self.interval)
        y, x = np.sign(float(self.settings.K or 1.0)) * level[0], level[1:]
        y = with_least_noise(y, first)
        return Rows(y, x, widths, first, lag, line, at, np.ascontiguousarray(means[:, -STEM:].T))

    def _covered(self, means: FloatArray) -> float:
        """How much of its span OP covered in one go: between recordings the stem may have moved, nobody knows how."""
        run, _, low, high = means[:, -STEM:].T
        return self._blocks.range if run[0] == run[-1] else min(self._blocks.range, float(np.max(high - low)))

    def finish(self) -> Confirmation | Note:
        """Return what the record says about a dead band, or why it says nothing."""
        rows = self.rows()
        if isinstance(rows, Note):
            return rows
        found = self._weighed(rows)
        loose = 0.0 if rows.stem is None else float(np.mean(rows.stem[3] - rows.stem[2] < found.d))
        return self._confirmation(found, bool(len(rows.line)), loose)

    def _weighed(self, rows: Rows) -> Evidence:
        """The evidence in `rows`, beside a load that switches to and fro where there is one.

        The fit of such a load is costly: of a very long record half of the rows are taken for it, and only where a
        dead band is to be seen without it.
        """
        still = not self._blocks.setpoint_moves
        if self._blocks.count <= PLENTY:
            load = switching_load(rows) if still else None
            if load is not None:
                return with_switching_load(rows, weigh(rows), load)
            return weigh_with_stem(rows, weigh_lightly(rows))
        found = weigh_with_stem(rows, weigh_lightly(rows))
        if still and found.gain > EVIDENCE:
            part = beginning(rows, MOST_ROWS // 2)
            load = switching_load(part)
            if load is not None:
                beside = with_switching_load(part, weigh(part), load)
                return beside if beside.half_period > 0.0 else found
        return found

    def _confirmation(self, e: Evidence, swings: bool, loose: float) -> Confirmation:
        low, high = widened(e.d, e.interval, e.steps, swings, e.half_period > 0, loose)
        span = self._blocks.range
        details: dict[str, float | str] = {
            "evidence": e.gain, "half": e.half, "mirror": e.mirror, "responds": e.responds, "steps": float(e.steps),
            "rows": float(e.rows), "block_s": self.size * self.interval, "output_range": span, "noise": e.noise,
            "gain_to_pv": e.gain_to_pv, "load_swings": float(swings or e.half_period > 0),
            "load_half_period_s": e.half_period * self.size * self.interval,
            "output": "rebuilt" if self._rebuilder else "recorded",
        }
        return Confirmation(e.d, (low, high), e.error_reduction, 2.0 * e.gain - float(np.log(max(e.rows, 1))),
                            limit_of_detection(e, span), details, e.profile)


def confirm(record: Record, settings: LoopSettings | None = None) -> Confirmation | Note:
    """Test one record for a dead band between OP and PV; the same as one update of a ConfirmationScanner."""
    scanner = ConfirmationScanner(settings or record.settings, record.interval)
    scanner.update(record)
    return scanner.finish()


def with_least_noise(y: FloatArray, first: NDArray[np.bool_]) -> FloatArray:
    """Return y (rows,) with a little noise where it has none: a model that must explain every digit explains nothing.

    Without noise the smallest error of the process model counts as a move of the load, and OP's share is lost.
    first (rows,): True where a stretch begins. The noise is the same in every run.
    """
    whole = ~(first[1:-2] | first[2:-1] | first[3:])
    third = np.abs(np.diff(y, 3)[whole])
    seen = float(np.median(third)) / 0.6745 / np.sqrt(20.0) if len(third) else 0.0
    least = min(LEAST_NOISE * float(np.std(y)), MOST_ADDED)
    if seen >= least:
        return y
    added: FloatArray = y + np.random.default_rng(0).normal(0.0, np.sqrt(least**2 - seen**2), len(y))
    return added


def widened(d: float, interval: tuple[float, float], steps: int, swings: bool,
            switches: bool = False, loose: float = 0.0) -> tuple[float, float]:
    """Return the 95 % interval of d: the likelihood interval, widened to hold the truth in 96 % of simulated loops.

    loose: share of the rows before OP has covered d since its run began.
    """
    floor = d * (SPREAD_FLOOR + SPREAD_PER_STEP * steps + SPREAD_OF_LINE * swings + SPREAD_OF_SWITCHING * switches
                 + SPREAD_OF_START * loose)
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


def _in_words(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds < 120.0 else f"{seconds / 60.0:.3g} min"
