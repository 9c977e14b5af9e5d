"""One verdict from all evidence: PV against OP, the half periods of the error, oscillation, and the record's quality.

PV against OP decides, where it can be tested. The published estimates (15) stand beside it: agreement adds
confidence, disagreement is said, and neither number is averaged into the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..record import Note
from ..results import NOTHING_SAID, Cluster, Confirmation, Verdict
from .criteria import CALLED, CLEARED, CLEARED_TESTED, by_hand, confidence, read, times

ENOUGH = 3  # similar estimates (15) that make a cluster worth comparing
AGREE = 0.35  # the estimates (15) read low by noise and high by load: agreement is within this share
HEALTHY = 0.92  # of the strange loops that were cleared
BLOCKED, LIMITED = "blocks", "limits"
STORAGE = ("compressed_held", "compressed_linear", "scanned_slowly")  # hold for tests in manual as well
DECIDED, SEEN = (Verdict.BACKLASH, Verdict.NO_BACKLASH), (Verdict.BACKLASH, Verdict.SUSPECTED)
TOO_FEW = {"weak_evidence", "few_reversals", "single_event", "size_unknown"}  # what a second test makes good
DISPUTED, JOINT = 0.6, 0.9  # confidence where manual and automatic speak against each other, and for each other
TOO_LITTLE = "short_record"  # what only more data can mend; all else cannot be told from data of this kind


@dataclass(frozen=True)
class Findings:
    """All that the verdict is made of. confirmation: a Note says why PV could not be tested against OP, None that it
    was not asked for. detections: half periods that pass the publication's gates. oscillation: share of the record and
    period [s]. quality: notes whose values["effect"] says what they mean for the verdict. output_step: rounding step of
    OP [span], 0 when not rounded or rebuilt. reading: what is to be said of the half periods besides their centre.
    manual: what tests of the valve in manual say, a Note why they say nothing, None where there were none."""

    cluster: Cluster | None
    detections: int
    long_half_periods: int
    oscillation: tuple[float, float]
    confirmation: Confirmation | Note | None = None
    quality: tuple[Note, ...] = ()
    output_step: float = 0.0
    reading: tuple[Note, ...] = ()
    manual: Confirmation | Note | None = None

    @property
    def limits(self) -> tuple[Note, ...]:
        """What keeps a finding from being more than a suspicion."""
        return tuple(note for note in self.quality if note.values.get("effect") == LIMITED)

    @property
    def tight(self) -> Cluster | None:
        """The cluster, where enough of the estimates are alike."""
        c = self.cluster
        return c if c is not None and c.n >= ENOUGH and c.spread < 0.5 and c.share >= 0.5 else None

    @property
    def swinging(self) -> tuple[Note, ...]:
        """A note where the loop oscillates most of the time."""
        share, period = self.oscillation
        return () if share <= 0.5 else (
            Note("oscillation", f"the control error oscillates with a period of {period:.3g} s during {share:.0%} of "
                 "the record", {"period_s": period, "share": share}),)


@dataclass(frozen=True)
class Decision:
    """Verdict, reasons (the weightiest first), confidence that the verdict is right, the number to go with it, and the
    test of PV against OP that it rests on."""

    verdict: Verdict
    reasons: tuple[Note, ...]
    confidence: float
    cluster: Cluster | None
    confirmation: Confirmation | None = None


def decide(f: Findings) -> Decision:
    """Return the verdict on one loop: from the test in manual where it decides, else from automatic operation."""
    confirmation = f.confirmation if isinstance(f.confirmation, Confirmation) else None
    automatic = replace(_in_automatic(f), confirmation=confirmation)
    if f.manual is None:
        return automatic
    if isinstance(f.manual, Confirmation):
        return _with_test(f, f.manual, automatic)
    if f.manual.code == "manual_no_answer" and automatic.verdict in (*NOTHING_SAID, Verdict.SUSPECTED):
        wide = automatic.cluster and automatic.cluster.d >= float(f.manual.values["at_least"])
        return replace(automatic, verdict=Verdict.SUSPECTED, reasons=(f.manual, *automatic.reasons), confidence=0.5,
                       cluster=automatic.cluster if wide else None)
    return replace(automatic, reasons=(*automatic.reasons, f.manual))


def _with_test(f: Findings, c: Confirmation, automatic: Decision) -> Decision:
    """What a test in manual adds to the verdict from automatic operation."""
    storage = tuple(replace(note, values={**note.values, "effect": LIMITED}) for note in f.quality
                    if note.code in STORAGE or (note.values.get("effect") == LIMITED
                                                and not note.code.startswith("settings_")))  # in manual K is not used
    tested = replace(_from_confirmation(replace(f, oscillation=(0.0, 0.0), quality=storage), c), confirmation=c)
    span, tests, evidence = (float(c.details[name]) for name in ("output_range", "recordings", "evidence"))

    def note(says: str) -> Note:
        return Note("manual_test", f"test of the valve in manual: OP was moved over {100 * span:.2g} % of its span, "
                    f"{times(tests)}; {says}", {"output_range": span, "tests": tests, "evidence": evidence})

    if tested.verdict is automatic.verdict is Verdict.SUSPECTED and _joined(f, c):
        assert isinstance(f.confirmation, Confirmation)
        says = note("neither this nor normal operation is proof alone, but both see the same dead band")
        return replace(min(automatic, tested, key=_width), verdict=Verdict.BACKLASH,
                       reasons=(says, _explained(c), _explained(f.confirmation), LOOK_ALIKE), confidence=JOINT)
    at_least = (*DECIDED, Verdict.SUSPECTED) if automatic.verdict in NOTHING_SAID else DECIDED
    if tested.verdict not in at_least:
        says = note("it does not decide: " + _missing(c, tested, f.output_step))
        return replace(automatic, reasons=(*automatic.reasons, says))
    keeps = (_width(automatic) < _width(tested) if automatic.verdict is tested.verdict else
             automatic.verdict in SEEN and tested.verdict is Verdict.NO_BACKLASH and not _contradict(automatic, tested))
    first, other = (automatic, tested) if keeps else (tested, automatic)
    reasons = [note("it does not contradict normal operation, which tells more" if keeps else
                    "PV against OP in manual is the cleanest evidence there is, and the verdict rests on it"),
               *first.reasons]
    sure = max(d.confidence for d in (first, other) if d.verdict is first.verdict)
    if _contradict(automatic, tested):
        sure = min(sure, DISPUTED)
        reasons.insert(1, Note("tests_differ", "normal operation speaks against the test: " + other.reasons[0].message))
    if automatic.verdict is Verdict.OSCILLATING:
        reasons.append(automatic.reasons[0])
    return replace(first, reasons=tuple(reasons), confidence=sure)


def _missing(c: Confirmation, tested: Decision, output_step: float) -> str:
    """What a test in manual would have needed to decide."""
    if tested.verdict is Verdict.SUSPECTED:
        return "; ".join(note.message for note in read(c, output_step=output_step).against) or tested.reasons[1].message
    if c.details["trace"]:
        return f"there is no more than a trace of a dead band of {100 * c.d:.2g} %"
    return ("noise and load hide what PV answers, or OP did not go back far enough twice; larger steps, up, up, down, "
            "down and again, each held until PV stands, would tell")


def _joined(f: Findings, c: Confirmation) -> bool:
    """Do the test in manual and normal operation see the same dead band, each with too little evidence alone?"""
    other = f.confirmation
    if not isinstance(other, Confirmation) or f.limits:
        return False
    lacking = {note.code for one in (c, other) for note in read(one, output_step=f.output_step).against}
    return lacking <= TOO_FEW and max(c.ci95[0], other.ci95[0]) <= min(c.ci95[1], other.ci95[1])


def _contradict(automatic: Decision, tested: Decision) -> bool:
    """Does one see a dead band of a size which the other would have seen, and did not?"""
    for one, other in ((automatic, tested), (tested, automatic)):
        if one.verdict in SEEN and other.verdict is Verdict.NO_BACKLASH and one.cluster and other.cluster:
            return one.cluster.d > (other.cluster.limit_of_detection or 0.0)
    return False


def _width(one: Decision) -> float:
    """How well it knows the size, or what it excludes: the width of the interval [span]."""
    return one.cluster.ci95[1] - one.cluster.ci95[0] if one.cluster else np.inf


def _in_automatic(f: Findings) -> Decision:
    blocking = tuple(note for note in f.quality if note.values.get("effect") == BLOCKED)
    if blocking:
        return Decision(Verdict.CANNOT_TELL, blocking, 0.0, f.cluster)
    if isinstance(f.confirmation, Confirmation):
        return _from_confirmation(f, f.confirmation)
    if f.swinging:
        return Decision(Verdict.OSCILLATING, f.swinging, 0.8, f.cluster)
    if f.confirmation is not None:
        verdict = Verdict.INSUFFICIENT_DATA if f.confirmation.code == TOO_LITTLE else Verdict.CANNOT_TELL
        return Decision(verdict, (f.confirmation,), 0.0, f.cluster)
    # without a test of PV against OP: what the half periods alone allow, by the paper's idea
    if f.long_half_periods == 0:
        note = Note("no_long_half_periods", "the control error never stays on one side for 5 Ti or longer")
        return Decision(Verdict.NO_BACKLASH, (note,), 0.5, f.cluster)
    if f.tight is not None:
        note = Note("estimates_agree", f"{f.tight.n} of {f.detections} estimates gather at "
                    f"{100 * f.tight.d:.2g} % of span; PV was not tested against OP")
        return Decision(Verdict.SUSPECTED, (note, *f.reading), 0.5, f.cluster)
    note = Note("estimates_scatter", f"{f.detections} detections, not enough of them alike")
    return Decision(Verdict.CANNOT_TELL, (note,), 0.0, f.cluster)


def _from_confirmation(f: Findings, c: Confirmation) -> Decision:
    reading, limits, of = read(c, output_step=f.output_step), f.limits, f.cluster
    sure = confidence(float(c.details["evidence"]), by_hand(c))
    agree = f.tight is not None and abs(f.tight.d - c.d) <= AGREE * c.d
    reasons = [_explained(c), LOOK_ALIKE]
    if of is not None and of.n >= ENOUGH:
        reasons.append(Note("methods_agree" if agree else "methods_differ", (
            f"{of.n} half periods of the error give {100 * of.d:.2g} % by the published rule, in agreement"
            if agree else f"the published rule on half periods of the error gives {100 * of.d:.2g} % ({of.n} similar "
            "estimates); it reads low with noise on OP and high with setpoint moves and changing load, so the number "
            "from PV against OP is reported"), {"published": of.d, "confirmed": c.d, "n": float(of.n)}))
    reasons += f.reading
    # the number to report; what was found was seen: a limit above it would say that it cannot have been
    size = Cluster(c.d, c.ci95, (c.ci95[1] - c.ci95[0]) / (2.0 * c.d) if c.d > 0 else 0.0, of.n if of else 0,
                   of.share if of else 0.0, c.limit_of_detection and min(c.limit_of_detection, c.d))
    if reading.clear:
        if limits and not agree:
            return Decision(Verdict.SUSPECTED, (reasons[0], *limits, *reasons[1:]), 0.5, size)
        return Decision(Verdict.BACKLASH, (*reasons, *f.swinging, *limits), sure, size)
    if f.swinging:
        found = reasons[0] if reading.some else _not_explained(c)
        return Decision(Verdict.OSCILLATING, (*f.swinging, found, *reading.against, *limits), 0.7, None)
    if reading.some:
        return Decision(Verdict.SUSPECTED, (*reasons, *reading.against, *limits), min(sure, 0.75), size)
    return _nothing_found(f, c, limits)


def _nothing_found(f: Findings, c: Confirmation, limits: tuple[Note, ...]) -> Decision:
    span, limit = float(c.details["output_range"]), c.limit_of_detection
    if c.details["trace"]:
        trace = Note("not_separable", f"there is a trace of something like a dead band of {100 * c.d:.2g} %, which a "
                     "load or a curved valve would leave as well: a longer record, or a test of the valve, would tell",
                     {"d": c.d, "evidence": float(c.details["evidence"])})
        return Decision(Verdict.CANNOT_TELL, (trace, *limits), 0.0, None)
    if limit is None or limit > (CLEARED_TESTED if by_hand(c) else CLEARED):
        size = "no size" if limit is None else f"only {100 * limit:.2g} % and more"
        few = Note("little_information", f"no sign of a dead band, but {size} can be excluded by this record: "
                   f"OP moves over {100 * span:.2g} % of its span, and PV answers with little against its noise and "
                   "load; a longer record, or a setpoint bump of twice the suspected dead band, would tell",
                   {"output_range": span, **({} if limit is None else {"limit": limit})})
        return Decision(Verdict.CANNOT_TELL, (few, *limits), 0.0, None)
    seen = Note("limit_of_detection", f"a dead band of {100 * limit:.2g} % of span or more would have been seen",
                {"limit": limit})
    others = () if f.tight is None else (
        Note("half_periods_only", f"{f.tight.n} half periods of the error alone would give {100 * f.tight.d:.2g} %, "
             "but PV follows OP without it: they come from load or setpoint", {"published": f.tight.d}),)
    return Decision(Verdict.NO_BACKLASH, (_not_explained(c), seen, *others, *limits), 0.6 if limits else HEALTHY,
                    Cluster(0.0, (0.0, limit), 0.0, 0, 0.0, limit))


def _explained(c: Confirmation) -> Note:
    evidence, crossings = float(c.details["evidence"]), float(c.details["crossings"])
    rebuilt = " (OP rebuilt from SP, PV, K and Ti)" if c.details.get("output") == "rebuilt" else ""
    # three and six times what is asked for at least are clear and strong
    strength = "strong" if evidence > 6 * CALLED else "clear" if evidence > 3 * CALLED else "some"
    return Note("play_fits", f"PV follows OP through a dead band of {100 * c.d:.2g} % of span ({100 * c.ci95[0]:.2g} "
                f"to {100 * c.ci95[1]:.2g} %) better than OP itself ({strength} evidence, OP went back through it "
                f"{times(crossings)}){rebuilt}", {"d": c.d, "evidence": evidence, "crossings": crossings})


LOOK_ALIKE = Note("play_or_stiction", "play or stiction: a sticking valve that lags behind OP in the same way looks "
                  "alike in normal operation; a slow ramp of OP in manual tells them apart (stiction moves in jumps)")


def _not_explained(c: Confirmation) -> Note:
    return Note("play_does_not_fit", "PV follows OP without a dead band as well as with one",
                {"evidence": float(c.details["evidence"])})
