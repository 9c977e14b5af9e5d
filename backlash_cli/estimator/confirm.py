"""PV against OP: is there a dead band between them, how wide, and which size would this record have shown?

    confirm(record) -> Confirmation | Note      a Note says why the test could not be made

The same question is asked in block means of about Ti/8, Ti/4, Ti/2 and Ti (short records Ti/16 as well): dead bands of
slow loops show in long blocks, of fast ones in short ones. The evidence is the sum of what PV's answer to the gap as
to OP and an answer of its own bring, each the mean of the two lengths that show it best, less half of what gaps that
forget would gain in its place: a load or a curved valve that is not linear gains for both. It counts near the width
that explains most in the mean over all lengths: a gap that PV cannot answer, but explains far more, is not proved by
what a fraction of it explains. Where there is a trace, those two lengths are asked again, with more rows and finer
widths, for the size. What is excluded where there is no evidence is the matter of `width_profile`."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from ..record import AT_LIMIT, BoolArray, FloatArray, Frozen, LoopSettings, Note, Record, SampleState, duration
from ..results import Confirmation
from ..words import noted
from .control_law import output_made
from .criteria import FEWEST_CROSSINGS
from .gap_test import GapTest, answers_output, forgetting_gaps_in, gaps_in, gaps_tested, imitation_gains, stem_known
from .predictor import Predictor, Recording, in_blocks, paired, predictor, recording_of
from .quality import stored_as
from .survey import measured
from .wave import autocorrelation
from .width_profile import NARROWEST, TRACE, TURN, about, confirmation, excluded, peak_of, width_interval

Said = TypeVar("Said")
PARTS_OF_TI, LONGEST = 8, 1.4  # of Ti: the shortest block is one part, or half of it; the longest, in Ti
SHORT = 1500  # blocks of one part; halves are tried only in records of fewer
MOST_ROWS = 3000  # of a longer record every second, third .. block is predicted, each from all that lies before it;
ROWS_OF_SIZE = 6000  # more for the size. With 6,000 rows no more dead bands are found than with 2,000
SIZED, NEAR = 2, 2  # block lengths that tell the size; how many widths beside the best evidence may come from
SHORTEST = 10.0  # integral times: a shorter record holds no loop's behaviour
FEWEST_BLOCKS = 60  # of Ti/8: no prediction can be fitted to fewer
WIDEST = 20.0  # % of span: the widest width tried
WIDTHS, FINE = 16, 9  # how many of them, and how many between the neighbours of the best
IMITATED = 0.5  # of what imitations gain is taken off
AS_GOOD = 0.8  # of what the best imitation gains, that a gap must gain at least
LEAST_INTERVAL, IMPERFECTION = 0.1, 0.4  # of d, each way: floor, and what imitations gain as a share of the gap's gain
WELL_KNOWN = 0.9  # of the rows: where the stem is known in fewer, a free answer fits what came before
DOUBT = 0.25  # of what imitations gain [nats]: differences of gains are no better known than that
HOLE = 20  # samples; a hole as long ends a recording
LEAD = 2000  # samples before a test, at most as many as in it: where the stem stood, and what PV still answers to
MOST_TESTS = 12  # the last ones
COARSE = 8.0  # samples per Ti, of a record with fewer than that the controller is sure to have seen OP turn in between


class Asked(Frozen):
    """What one block length says: the prediction, gaps tested in it, and what the best imitation gains."""

    prediction: Predictor
    test: GapTest
    imitation: float

    @property
    def net(self) -> FloatArray:
        """Evidence (widths,) [nats] of gaps that are a possible answer of PV."""
        return self.test.answer - IMITATED * self.imitation

    @property
    def free(self) -> FloatArray:
        """The same of gaps that PV answers in its own way, where the record knows where the stem stands."""
        return np.where(self.test.counted >= WELL_KNOWN, self.test.free, -1.0) - IMITATED * self.imitation


class Study(Frozen):
    """What was asked of one record. asked: by block length. length: of the record in integral times; moved: how far OP
    did [%]; output: as of `output_made`; rounding: what recording leaves in means of PV [%]."""

    asked: tuple[Asked, ...]
    recordings: tuple[Recording, ...]
    settings: LoopSettings
    Ti: float
    interval: float
    length: float
    moved: float
    output: str
    rounding: float

    def crossed(self, d: float) -> int:
        """How often OP, in automatic, went through a gap of d [%] and back."""
        from ..kernels import gap_crossings
        return sum(gap_crossings(r.output[r.usable], d) for r in self.recordings)

    def excludes(self, evidence: float) -> float | None:
        """The smallest dead band [%] that the record excludes. It must show that PV answers OP: the play of a valve
        that never moved is wider than all OP did. One event proves absence no more than presence."""
        limit = excluded([a.test for a in self.asked], evidence, self.length, self.moved)
        return limit if limit and self.crossed(limit) >= FEWEST_CROSSINGS and answers_output(
            [a.prediction for a in self.asked], self.settings.K, self.Ti, self.interval) else None


def confirm(record: Record, settings: LoopSettings | None = None) -> Confirmation | Note:
    """Test PV against OP through a dead band; a Note says why the test could not be made.

    Ti sets the lengths of the blocks; where it is not known the memory of the control error stands in. K gives the
    sign and the possible size of PV's answer, where it is known. OP is completed where few of it was recorded."""
    found = study(record, settings or record.settings)
    return found if isinstance(found, Note) else _confirmation(found)


def study(record: Record, settings: LoopSettings) -> Study | Note:
    """Ask of a record all that its confirmation is made of, or say why it cannot be asked."""
    usable = record.usable & np.isfinite(record.measurement)
    (output, origin), Ti = output_made(record, settings), settings.Ti or 0.0
    if output is None:
        return noted("no_output:test")
    usable &= np.isfinite(output)
    if not usable.any():
        return noted("short_record:none", {"usable_s": 0.0})
    if not Ti:
        error = np.where(np.isfinite(record.setpoint), record.setpoint, 0.0) - record.measurement
        Ti = 0.5 * memory(error[usable]) * record.interval
    if not (recordings := _recordings(record, output, usable)):
        return noted("short_record:holes", samples=np.count_nonzero(usable), least=FEWEST_BLOCKS, hole=HOLE)
    moves = np.concatenate([r.output[r.usable] for r in recordings])
    moved, seconds = float(np.ptp(moves)), len(moves) * record.interval
    if moved < NARROWEST * 1.5:
        return noted("output_still", {"output_range": moved / 100.0})
    if not any(np.ptp(r.measurement[r.usable]) > 0 for r in recordings):
        return noted("measurement_constant")
    rounding = 100.0 * stored_as(*measured(record)[:2]).error
    asked = _asked(recordings, moved, settings.K, Ti, record.interval, rounding) if seconds >= SHORTEST * Ti else ()
    if not asked:
        code = "short_record" if seconds < SHORTEST * Ti else "short_record:stretches"
        return noted(code, {"usable_s": seconds}, used=duration(seconds), least=duration(SHORTEST * Ti))
    return Study(asked, recordings, settings, Ti, record.interval, seconds / Ti, moved, origin, rounding)


def _recordings(record: Record, output: FloatArray, usable: BoolArray) -> tuple[Recording, ...]:
    """The samples on grids without gaps, in % of span, OP and PV less their means."""
    mean, found = 100.0 * float(output[usable].mean()), []
    for part in np.split(np.arange(len(record)), np.flatnonzero(np.diff(record.index) > HOLE) + 1):
        ok = usable[part]
        if np.count_nonzero(ok) < FEWEST_BLOCKS:
            continue
        cut = slice(part[ok][0], part[ok][-1] + 1)
        found.append(recording_of(record.index[cut], output[cut], record.measurement[cut], usable[cut], scale=100.0))
        for values, level in ((found[-1].output, mean), (found[-1].measurement, found[-1].measurement.mean())):
            values -= level  # in place: long records
    return tuple(found)


def manual_stretches(record: Record) -> list[Recording]:
    """Return the stretches in manual in which OP went there and back, in % of span, the last MOST_TESTS of them;
    each with what lies before it, which is not `usable`."""
    index, state, output = record.index, record.state, record.output
    if output is None or not (state == SampleState.MANUAL).any():
        return []
    from ..kernels import gap_crossings
    by_hand = (state == SampleState.MANUAL) & (output > AT_LIMIT) & (output < 1.0 - AT_LIMIT)
    lost = (state == SampleState.MISSING) | (state == SampleState.IMPLAUSIBLE)
    rows = np.flatnonzero(by_hand)
    others = np.cumsum(~by_hand & ~lost)
    apart = np.flatnonzero((np.diff(others[rows]) > 0) | (np.diff(index[rows]) > HOLE)) + 1
    holes = np.append(0, np.flatnonzero(np.diff(index) > HOLE) + 1)
    found = []
    for part in np.split(rows, apart):
        if not len(part) or not gap_crossings(100.0 * output[part], NARROWEST):
            continue
        lead = min(part[-1] + 1 - part[0], LEAD)
        first = max(part[0] - lead, holes[np.searchsorted(holes, part[0], side="right") - 1])
        cut = slice(first, part[-1] + 1)
        usable = by_hand[cut] & np.isfinite(record.measurement[cut])
        usable[: part[0] - first] = False
        if not usable.any():
            continue
        found.append(recording_of(index[cut], output[cut], record.measurement[cut], usable, scale=100.0))
    return found[-MOST_TESTS:]


def _asked(recordings: Sequence[Recording], moved: float, K: float | None, Ti: float, interval: float, rounding: float
           ) -> tuple[Asked, ...]:
    widths = np.geomspace(NARROWEST, max(min(WIDEST, TURN * moved), 1.5 * NARROWEST), WIDTHS)
    sizes = _block_lengths(recordings, Ti / interval)
    predictions = _predictions(recordings, sizes, moved, MOST_ROWS, rounding)
    tests = _tests(predictions, recordings, widths, sizes[0], K, Ti, interval)
    gains = _at_each_length(predictions, [forgetting_gaps_in(r.output, widths[::3], sizes[0], Ti / interval)
                                          for r in recordings], imitation_gains)
    return tuple(Asked(p, test, float(gain.max())) for p, test, gain in zip(predictions, tests, gains, strict=True)
                 if p is not None and test is not None and gain is not None)


def _tests(predictions: Sequence[Predictor | None], recordings: Sequence[Recording], widths: FloatArray, size: int,
           K: float | None, Ti: float, interval: float, alike: float = 0.0) -> list[GapTest | None]:
    """Gaps of `widths` in predictions from blocks of `size` on; those up to `alike` are compared on the same rows."""
    known = [stem_known(r.output, np.maximum(widths, alike)) for r in recordings]
    # made where they are handed over: of a long record they are as large as it is, and nobody else may keep them
    return _at_each_length(predictions, [gaps_in(r.output, widths, size) for r in recordings],
                           lambda p, gaps: gaps_tested(p, gaps, known, widths, K, Ti, interval))


def _block_lengths(recordings: Sequence[Recording], Ti: float) -> list[int]:
    """Lengths [samples] of the blocks, each twice the one before, from a part of Ti [samples] to about Ti."""
    samples, finest = sum(len(r.output) for r in recordings), max(1, round(Ti / PARTS_OF_TI))
    if samples // finest < SHORT:
        finest = max(1, round(Ti / (2 * PARTS_OF_TI)))
    return [finest << k for k in range(6) if finest << k <= max(LONGEST * Ti, finest)]


def _at_each_length(predictions: Sequence[Predictor | None], signals: list[FloatArray],
                    ask: Callable[[Predictor, list[FloatArray]], Said]) -> list[Said | None]:
    """Ask each prediction about signals (signals, blocks) of each recording, given in blocks of the first's size."""
    found: list[Said | None] = []
    for p in predictions:
        found.append(None if p is None else ask(p, signals))
        signals = [paired(means) for means in signals]
    return found


def _predictions(recordings: Sequence[Recording], sizes: Sequence[int], moved: float, most: int,
                 rounding: float) -> list[Predictor | None]:
    deviation = float(np.sqrt(np.mean(np.concatenate([r.measurement - r.measurement.mean() for r in recordings]) ** 2)))
    if deviation == 0.0:
        return [None] * len(sizes)
    blocks, found = [in_blocks(r, sizes[0], moved, deviation) for r in recordings], []
    for _ in sizes:
        found.append(predictor(blocks, deviation, most, rounding))
        blocks = [b.coarser for b in blocks]
    return found


def _confirmation(s: Study) -> Confirmation:
    evidence = _evidence(s.asked)
    best = sorted(s.asked, key=lambda a: float(a.net.max()), reverse=True)[:SIZED]
    grid, tests = best[0].test.widths, [a.test for a in best]
    if evidence >= TRACE:
        fine = about(grid, int(_gained(tests).argmax()), FINE)
        grid = np.sort(np.append(grid, fine))
        # the widths among which the size is sought are compared on the same rows
        tests = _again([a.prediction for a in best], grid, max(fine), s)
    gained, of = _gained(tests), tests[0]
    d, at = peak_of(grid, gained), int(gained.argmax())
    imitation = float(np.mean([a.imitation for a in best]))
    imperfection = min(imitation / max(float(gained[at]), 1e-9), 1.0)
    low, high = width_interval(grid, gained, d, LEAST_INTERVAL + IMPERFECTION * imperfection, DOUBT * imitation)
    for a, test in zip(best, tests, strict=True):  # a size that another block length does not share is known less well
        if a.net.max() > 0.0:
            low, high = min(low, peak_of(grid, test.gain)), max(high, peak_of(grid, test.gain))
    # so much narrower [%] it looks: OP turned between samples, half a step further out, where the controller is faster
    steps = np.concatenate([np.abs(np.diff(r.output))[r.usable[1:]] for r in s.recordings])
    unseen = float(steps.mean()) * min(1.0, COARSE * s.interval / s.Ti)
    d, high = d + unseen, high + 2.0 * unseen
    details: dict[str, float | str] = {"evidence": evidence, "gain": float(gained[at]), "imitation": imitation,
        "share": float(of.share[at]), "share_deviation": float(of.deviation[at]),
        "edge": float(at in (0, len(grid) - 1)), "rows": float(best[0].prediction.rows),
        "block_s": best[0].prediction.size * s.interval, "output_range": s.moved / 100.0,
        "crossings": float(s.crossed(d)), "unseen_motion": unseen / 100.0, "recordings": float(len(s.recordings)),
        "trace": float(evidence >= TRACE), "sign_known": float(s.settings.K is not None), "output": s.output}
    return confirmation(d, (low, high), float(of.error_reduction[at]), s.excludes(evidence), details, grid, gained)


def _gained(tests: Sequence[GapTest]) -> FloatArray:
    """What gaps of each width explain in the mean over block lengths (widths,) [nats], however PV answers them."""
    return np.asarray(np.mean([test.gain for test in tests], axis=0))


def _again(predictions: Sequence[Predictor], widths: FloatArray, widest: float, s: Study) -> list[GapTest]:
    """The same block lengths asked with more rows: the size is worth more of them than whether there is a dead band."""
    closer = {p.size: p if p.every == 1 else _predictions(s.recordings, [p.size], s.moved, ROWS_OF_SIZE, s.rounding)[0]
              or p for p in predictions}
    sizes = [size for k in range(8) if (size := min(closer) << k) <= max(closer)]
    tests = _tests([closer.get(size) for size in sizes], s.recordings, widths, sizes[0], s.settings.K, s.Ti, s.interval,
                   widest)
    found = dict(zip(sizes, tests, strict=True))
    return [test for p in predictions if (test := found[p.size]) is not None]


def memory(values: FloatArray) -> float:
    """Lag [samples] at which the autocorrelation of values (samples,) has fallen to 1/e; of a loop about 2 Ti."""
    v = values[: 1 << 18]
    below = np.flatnonzero(autocorrelation(v, len(v)) < np.exp(-1.0))
    return float(max(below[0], 1)) if len(below) else float(len(v))


def _evidence(asked: Sequence[Asked]) -> float:
    """Evidence [nats] for the best width: of tied and free answers, each the mean of the two block lengths that show it
    best. In one of them the tied answer must be possible; slow parts of it are known too badly to ask that of both."""
    # where an imitation does clearly better than the gap there is no evidence: so it is under a load that switches
    kept = [np.where(a.test.fit > AS_GOOD * a.imitation, np.inf, 0.0) for a in asked]
    possible = np.max([np.minimum(a.net, k) for a, k in zip(asked, kept, strict=True)], axis=0)
    fitting = [np.minimum(a.test.fit - IMITATED * a.imitation, k) for a, k in zip(asked, kept, strict=True)]
    second = np.sort(fitting, axis=0)[-2] if len(asked) > 1 else 0.0
    found = np.where(possible > 0.0, 0.5 * (possible + second), np.minimum(possible, 0.0))
    found += np.mean(np.sort([a.free for a in asked], axis=0)[-SIZED:], axis=0)
    best = int(_gained([a.test for a in asked]).argmax())
    return float(np.max(found[max(best - NEAR, 0) : best + NEAR + 1]))
