"""The least that would decide a loop: each candidate played again and again on its twins, and judged by the scan.

Two twins of the loop, one with a dead band of the target's size and one with a healthy valve, both as the record allows
them. A candidate is played on both, what the historian would keep of it goes behind the record, and the whole is
scanned. A rung of a ladder that does not promise enough after a few repeats is left for the next, larger one."""

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import LoopError
from ..estimator.criteria import CALLED_TESTED, CLEARED, by_hand
from ..estimator.quality import data_quality
from ..record import Frozen, Record
from ..results import UNDECIDED, LoopReport, Verdict
from ..results.advice import ENOUGH, Course, LoopPlan, PlanOption
from ..scanning import scan
from .twin import KINDS, TENTH, Move, Test, Twin, behind, twins_of
from .words import logging_words, model_words, option_words

TARGET = 0.02  # span: dead band that matters, where the record has no limit of detection
LOOKS = ((2, 0.5), (6, 0.5), (20, 0.7))  # repeats of a rung, and what its chance must be for more of them
MARGIN = 2.0  # times the evidence that a scan asks of a test: twins are like their loops, not the same
SURE = 0.9  # chance from which on no longer test is tried
TOLD = 1.1  # limits of detection are told in steps, 2.03 % is one of them
LONGER = (1.0, 3.0, 9.0)  # waits, in lengths of the record
LONGEST_WAIT, LEAST_WAIT = 14 * 86400.0, 20.0  # seconds; integral times
LEAST_TEST, LONGEST_TEST = 1800.0, 8 * 3600.0  # seconds in manual: what setting it up takes anyway; a shift
MOST_SAMPLES = 150_000  # of a simulated wait
HOLD = 10.0  # integral times that a setpoint is held
TURNS = (2, 4)  # times up and down, where once is not enough
AROUND = 5.0  # integral times of ordinary operation before and after a test
# OP in manual goes up and down in steps of the target's size, of which the first one back does nothing and the second
# all, then in larger ones: they shrink the delay of play, not that of a process; more rounds average the load
LARGER, ALIKE, ROUNDS = 2.5, 1.2, (2, 5, 12, 30)
HOLDS, FEWEST_HELD = (1.5, 3.0), 20.0  # integral times beyond the dead time that a step is held; samples, at least
ACROSS = (2.0, 4.0)  # moves of the valve worth trying, in dead bands of the target's size
OVER = 1.1  # what a move may go beyond a limit before it counts as beyond it: repeats differ
OVERSHOOT = 1.3  # of PV beyond what is expected of it, that limits must allow for
FEW, POINTS = 20, 400  # repeats that tell how far a test moves PV; of a drawn course


class PlanOptions(Frozen):
    """target: dead band that matters [span], None: the record's limit of detection, else 2 %. max_pv_move,
    max_op_move: how far a test may move PV and OP from where they stand. repeats: of each candidate with a
    worn and with a healthy valve. kinds: of tests that are weighed."""

    target: float | None = None
    max_pv_move: Move = TENTH
    max_op_move: Move = TENTH
    repeats: int = 100
    seed: int = 0
    kinds: tuple[str, ...] = KINDS


@dataclass
class Played:
    """A test, what the scan said of its repeats with a worn and a healthy valve, how far it moved PV, OP [spans]."""

    test: Test
    worn: Counter[Verdict] = field(default_factory=Counter)
    healthy: Counter[Verdict] = field(default_factory=Counter)
    moves: list[tuple[float, ...]] = field(default_factory=list)

    @property
    def moved(self) -> tuple[float, float]:
        """How far the test alone moves PV and OP in nine of ten repeats, 0 for a wait."""
        pv, op = np.percentile(self.moves, 90.0, axis=0) if self.moves else (0.0, 0.0)
        return float(pv), float(op)

    @property
    def chance(self) -> float:
        """Chance to be told, of the valve that is harder to tell."""
        return min(self.worn[Verdict.BACKLASH], self.healthy[Verdict.NO_BACKLASH]) / max(self.worn.total(), 1)


def plan(record: Record, options: PlanOptions | None = None, report: LoopReport | None = None) -> LoopPlan | None:
    """Return what would decide a loop, None where the scan has decided it or could not read it.

    report: the record's scan, made here if not given. Advice to a person; nothing is written to a control system."""
    options, report = options or PlanOptions(), report or scan(record)
    if report.verdict not in UNDECIDED:
        return None
    s = report.settings
    target = options.target or min(excluded(report) or TARGET, CLEARED)
    quality = data_quality(record, s.Ti)
    known = s.K is not None and s.Ti is not None
    codes = [n.code for n in (*report.reasons, *report.warnings, *quality.notes)] + ["missing_settings"] * (not known)
    fine = quality.op is None or 2.5 * quality.op.step <= target
    logging = [PlanOption("logging", text)
               for text in logging_words([code for code in codes if not (fine and code == "output_rounded")], s)]
    found = LoopPlan(record.loop, str(report.verdict), report.reasons[0].message if report.reasons else "", target,
                     tuple(logging), pv_range=s.pv_range, op_range=s.op_range)
    if not known:
        return found
    # where K and Ti come from is settled: they are not to be checked again in every repeat
    record = replace(record, settings=s.with_values("identified", K=s.K, Ti=s.Ti))
    rounding = (quality.pv.step, quality.op.step if quality.op else 0.0)
    try:
        worn, healthy = twins_of(record, (target, 0.0), rounding)
        subject = Subject(record, worn, healthy, options, target, report.verdict)
    except LoopError as error:
        return found if logging else replace(found, options=(PlanOption("logging", f"{error.what}: {error.remedy}"),))
    tried = sorted(subject.tried(), key=lambda o: (not o.decides, not o.within_limits) if o.decides else (
        True, -min(o.power or 0.0, o.clears or 0.0)))
    return replace(found, model=model_words(subject.healthy), options=(*logging, *tried))


@dataclass
class Subject:
    """One loop on the desk: its record, what the scan said, its twins with the target's dead band and without."""

    record: Record
    worn: Twin
    healthy: Twin
    options: PlanOptions
    target: float
    before: Verdict

    @property
    def limits(self) -> tuple[float, float]:
        """How far PV and OP may move [spans]."""
        s, o = self.record.settings, self.options
        return o.max_pv_move.share(s.pv_range), o.max_op_move.share(s.op_range)

    def tried(self) -> list[PlanOption]:
        """For every kind of test the least that decides, or why there is none."""
        makers = {"wait": self._waits, "setpoint_steps": self._setpoint_steps, "manual_test": self._manual_tests}
        # what oscillates goes on as it is, and a step would be lost in its swing
        found = [self._least(makers[kind]()) for kind in self.options.kinds
                 if kind == "manual_test" or self.before is not Verdict.OSCILLATING]
        return [one for one in found if max(one.pv_move or 0.0, one.op_move or 0.0) < 1.0]  # no signal leaves its span

    def _waits(self) -> list[Test]:
        h = self.record.interval
        length = max(len(self.record) * h, LEAST_WAIT * self.healthy.controller.Ti)
        return [Test("wait", t) for t in sorted({min(k * length, LONGEST_WAIT, MOST_SAMPLES * h) for k in LONGER})]

    def _setpoint_steps(self) -> list[Test]:
        w, (pv_most, op_most) = self.healthy, self.limits
        hold = max(HOLD * w.controller.Ti, 2.0 * w.answer_time)
        gain = w.settled(hold)
        # PV overshoots; OP kicks by K times the step, and goes for good by the step over the gain
        most = min(pv_most / OVERSHOOT, op_most / max(abs(w.controller.K), 1.0 / gain))
        least, large = (k * self.target * gain for k in ACROSS)
        large = max(least, min(large, most))
        once = (-1.0, 0.0) if w.level > 0.5 else (1.0, 0.0)
        return [*(Test("setpoint_steps", hold, size, once) for size in dict.fromkeys((least, large))),
                *(Test("setpoint_steps", hold, large, once * n) for n in TURNS)]

    def _manual_tests(self) -> list[Test]:
        """Up, down, down, up about where OP stood, so that a level comes back whatever the record says of it."""
        w, (pv_most, op_most) = self.healthy, self.limits
        once = np.array([1.0, 0.0, -1.0, 0.0])
        rungs: list[Test] = []
        for k in HOLDS:
            # of lags a record in automatic tells less than the tuning: a controller's Ti is made for them
            hold = max(min(w.process.dead_time + k * w.controller.Ti, LONGEST_TEST / (2 * len(once) * ROUNDS[0])),
                       FEWEST_HELD * self.record.interval)
            allowed = min(op_most, pv_most / (OVERSHOOT * w.settled(hold))) / self.target
            for larger in {float(np.clip(allowed, 1.0, LARGER)), LARGER}:
                levels = tuple(np.concatenate([once, larger * once] if larger > ALIKE else [once]).tolist())
                rungs += [Test("manual_test", hold, self.target, levels * n) for n in ROUNDS]

        def trouble(test: Test) -> tuple[bool, float]:
            allowed = OVER * min(op_most, pv_most / w.settled(test.hold))
            return test.move * max(map(abs, test.levels)) > allowed, test.duration

        least = min(LEAST_TEST, max(test.duration for test in rungs))  # a shorter one saves no time
        rungs = sorted((test for test in rungs if test.duration >= least), key=trouble)
        return [test for test in rungs if test.duration <= LONGEST_TEST] or rungs[:1]

    def _least(self, rungs: list[Test]) -> PlanOption:
        """Return the first rung that decides surely; else the most promising one: of several one within the limits, and
        the longest, as few repeats hardly tell their chances apart."""
        looks = [Played(test) for test in rungs]
        if rungs[-1].kind != "manual_test":  # where more of the same has no hope, less has none
            self._repeat(looks[-1], LOOKS[0][0])
            if looks[-1].chance < LOOKS[0][1]:
                return self._option(looks[-1])
        for played in looks:
            for upto, least in (*LOOKS, (self.options.repeats, SURE)):
                self._repeat(played, min(upto, self.options.repeats))
                if played.chance < least:
                    break
            else:
                if (option := self._option(played)).decides:
                    return option
        best = max(looks, key=lambda p: (min(p.chance, ENOUGH), self._excess(p) == 1.0, p.test.duration))
        self._repeat(best, min(LOOKS[1][0], self.options.repeats))
        return self._option(best)

    def _excess(self, played: Played) -> float:
        """How far a test goes beyond the limits: 1 for within."""
        return max(1.0, *(move / (OVER * limit) for move, limit in zip(played.moved, self.limits, strict=True)))

    def _repeat(self, played: Played, upto: int) -> None:
        """Go on until the test was played so often with each valve."""
        test = played.test
        # a test in manual speaks for itself, but where there was a suspicion
        alone = test.kind == "manual_test" and self.before is not Verdict.SUSPECTED
        for twin, said in ((self.worn, played.worn), (self.healthy, played.healthy)):
            for k in range(said.total(), upto):
                seed = 2 * (k + self.options.repeats * self.options.seed) + (twin is self.worn)
                around = 0.0 if test.kind == "wait" else AROUND * twin.controller.Ti
                try:
                    later, _, _ = twin.play(test, seed, around=around)
                except LoopError:  # a limit cycle that leaves the span: this test says nothing
                    said[Verdict.ERROR] += 1
                    continue
                report = scan(later if alone else behind(self.record, later))
                verdict, c = report.verdict, report.confirmation
                if verdict is Verdict.NO_BACKLASH and (excluded(report) or 0.0) > TOLD * self.target:
                    verdict = Verdict.CANNOT_TELL  # cleared, but of a larger dead band than the one that matters
                if (verdict is Verdict.BACKLASH and twin is self.worn and c and by_hand(c)
                        and float(c.details["evidence"]) < MARGIN * CALLED_TESTED):
                    verdict = Verdict.SUSPECTED
                said[verdict] += 1
                if test.move and len(played.moves) < FEW:
                    run, still = (twin.play(one, seed, around=around)[1]
                                  for one in (test, replace(test, kind="setpoint_steps", move=0.0)))
                    size = min(len(run.output), len(still.output))
                    pv, op = (float(np.abs(one[:size] - other[:size]).max()) for one, other in (
                        (run.process_output, still.process_output), (run.output, still.output)))
                    if test.kind == "manual_test":  # all else is what the controller would have done to OP
                        op = test.move * max(map(abs, test.levels))
                    played.moves.append((pv, op))

    def _option(self, played: Played) -> PlanOption:
        test, n = played.test, max(played.worn.total(), 1)
        pv, op = played.moved if played.moves else (None, None)
        option = PlanOption(test.kind, "", test.duration, test.move or None, test.levels if test.move else (),
            test.hold if test.move else None, op, pv, played.worn[Verdict.BACKLASH] / n,
            played.healthy[Verdict.NO_BACKLASH] / n, played.healthy[Verdict.BACKLASH] / n,
            played.worn[Verdict.NO_BACKLASH] / n, n, self._excess(played) == 1.0,
            *(None if test.kind == "wait" else self._course(twin, test) for twin in (self.worn, self.healthy)))
        return replace(option, text=option_words(option, self.healthy, self.target, self.limits))

    def _course(self, twin: Twin, test: Test) -> Course | None:
        try:
            _, run, begin = twin.play(test, 0, around=AROUND * twin.controller.Ti)
        except LoopError:
            return None
        first = max(round((begin - AROUND * twin.controller.Ti) / run.scenario.step), 0)
        pick = np.linspace(first, len(run.output) - 1, POINTS).astype(np.int64)
        return Course(tuple(np.round(run.time[pick] - begin, 2).tolist()),
                      *(tuple(np.round(x[pick], 6).tolist()) for x in (run.setpoint, run.measurement, run.output)))


def excluded(report: LoopReport) -> float | None:
    """Smallest dead band [span] that the record would have shown, None where it is not known."""
    return None if report.confirmation is None else report.confirmation.limit_of_detection
