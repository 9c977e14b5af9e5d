"""One verdict from all evidence: PV against OP, the half periods of the error, oscillation, and the record's quality.

PV against OP decides, where it can be tested. The published estimates (15) stand beside it: agreement adds
confidence, disagreement is said, and neither number is averaged into the other."""

from dataclasses import replace

import numpy as np

from ..record import Frozen, Note
from ..results import NOTHING_SAID, Cluster, Confirmation, Verdict
from ..words import noted, said, times
from .criteria import CALLED, CLEARED, CLEARED_TESTED, by_hand, confidence, weigh
from .haegglund import SUPERVISION
from .settings_check import contradicts

ENOUGH = 3  # similar estimates (15) that make a cluster worth comparing
AGREE = 0.35  # the estimates (15) read low by noise and high by load: agreement is within this share
HEALTHY = 0.92  # of the strange loops that were cleared
DOUBLED = 2.0  # evidence for the same confidence where data are limited, and for a call from a completed OP and such PV
LIMITED = "limits"
SWINGING = 0.5  # share of the record; with no half period of 5 Ti it is a limit cycle, which no gain heals
COARSE = ("sampling_too_coarse", "sampling_coarse")  # a worn valve hides between samples
STORAGE = ("compressed_held", "compressed_linear", "scanned_slowly")  # hold for tests in manual as well
BLURRED = {*STORAGE, "interpolated", "output_compressed"}  # the controller's law is not seen
BLIND = {"sampling_too_coarse", "compressed_linear"}  # play hides between samples, and between those that were kept
DECIDED, SEEN = (Verdict.BACKLASH, Verdict.NO_BACKLASH), (Verdict.BACKLASH, Verdict.SUSPECTED)
TOO_FEW = {"weak_evidence", "few_reversals", "single_event", "size_unknown"}  # what a second test makes good
DISPUTED, JOINT = 0.6, 0.9  # confidence where manual and automatic speak against each other, and for each other
TOO_LITTLE = "short_record"  # what only more data can mend; all else cannot be told from data of this kind


class Findings(Frozen):
    """All that the verdict is made of. confirmation: a Note says why PV could not be tested against OP, None that it
    was not asked for. detections: half periods that pass the publication's gates. oscillation: share of the record and
    period [s]. watched: time in half periods that were seen whole [Ti]. quality: notes whose values["effect"] says what
    they mean for the verdict. output_step: rounding step of OP [span], 0 when not rounded or rebuilt. reading: what is
    to be said of the half periods besides their centre. manual: what tests of the valve in manual say, a Note why
    they say nothing, None where there were none."""

    cluster: Cluster | None
    detections: int
    long_half_periods: int
    oscillation: tuple[float, float]
    watched: float
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
    def blocking(self) -> tuple[Note, ...]:
        """What allows no verdict on automatic operation."""
        return tuple(note for note in self.quality if note.values.get("effect") == "blocks")

    @property
    def tight(self) -> Cluster | None:
        """The cluster, where enough of the estimates are alike."""
        c = self.cluster
        return c if c is not None and c.n >= ENOUGH and c.spread < 0.5 and c.share >= 0.5 else None

    @property
    def swinging(self) -> tuple[Note, ...]:
        """A note where the loop oscillates most of the time."""
        share, period = self.oscillation
        note = noted("oscillation", {"period_s": period, "share": share}, percent=100 * share)
        return (note,) if share > SWINGING else ()


class Decision(Frozen):
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
    automatic = replace(_with_limits(_in_automatic(f), f), confirmation=confirmation)
    if f.manual is None:
        return automatic
    if isinstance(f.manual, Confirmation):
        return _with_test(f, f.manual, automatic)
    if f.manual.code == "manual_no_answer" and automatic.verdict in (*NOTHING_SAID, Verdict.SUSPECTED):
        wide = automatic.cluster and automatic.cluster.d >= float(f.manual.values["at_least"])
        return replace(automatic, verdict=Verdict.SUSPECTED, reasons=(f.manual, *automatic.reasons), confidence=0.5,
                       cluster=automatic.cluster if wide else None)
    return replace(automatic, reasons=(*automatic.reasons, f.manual))


def _with_limits(decision: Decision, f: Findings) -> Decision:
    """What limits the data is a reason of every decision, the last one where it was not said before."""
    return replace(decision, reasons=(*decision.reasons, *(n for n in f.limits if n not in decision.reasons)))


def _with_test(f: Findings, c: Confirmation, automatic: Decision) -> Decision:
    """What a test in manual adds to the verdict from automatic operation."""
    storage = tuple(replace(n, values={**n.values, "effect": LIMITED}) for n in f.quality if n.code in STORAGE or (
        n.values.get("effect") == LIMITED and not n.code.startswith("settings_")))  # in manual K is not used
    of_test = replace(f, oscillation=(0.0, 0.0), quality=storage)
    tested = replace(_with_limits(_from_confirmation(of_test, c), of_test), confirmation=c)
    span, tests, evidence = (float(c.details[name]) for name in ("output_range", "recordings", "evidence"))
    usable = f.cluster if f.cluster and f.cluster.n >= ENOUGH and not f.swinging and not f.blocking else None
    larger = usable is not None and usable.ci95[0] > c.ci95[1]
    if larger and tested.verdict is Verdict.BACKLASH:  # a load that moves PV after a step passes for a small gap
        tested = replace(tested, verdict=Verdict.SUSPECTED, confidence=0.5)

    def note(says: str, **shown: str) -> Note:
        return noted("manual_test", {"output_range": span, "tests": tests, "evidence": evidence}, times=times(tests),
                     says=said(f"manual_test:{says}", shown))

    if tested.verdict is automatic.verdict is Verdict.SUSPECTED and _joined(f, c):
        assert isinstance(f.confirmation, Confirmation)
        return replace(min(automatic, tested, key=_width), verdict=Verdict.BACKLASH, confidence=JOINT, reasons=(
            note("joined"), _explained(c), _explained(f.confirmation), noted("play_or_stiction")))
    open_question = automatic.verdict in NOTHING_SAID or _contradict(automatic, tested)
    at_least = (*DECIDED, Verdict.SUSPECTED) if open_question else DECIDED
    if tested.verdict not in at_least:
        missing = said("manual_test:trace" if c.details["trace"] else "manual_test:blind", d=c.d)
        if tested.verdict is Verdict.SUSPECTED:
            against = "; ".join(note.message for note in weigh(c, output_step=f.output_step).against)
            differ = next((note.message for note in tested.reasons if note.code == "methods_differ"), "")
            missing = against or (larger and differ) or tested.reasons[1].message
        return replace(automatic, reasons=(*automatic.reasons, note("undecided", missing=missing)))
    keeps = (_width(automatic) < _width(tested) if automatic.verdict is tested.verdict else
             automatic.verdict in SEEN and tested.verdict is Verdict.NO_BACKLASH and not _contradict(automatic, tested))
    first, other = (automatic, tested) if keeps else (tested, automatic)
    reasons = [note("keeps" if keeps else "decides"), *first.reasons]
    sure = max(d.confidence for d in (first, other) if d.verdict is first.verdict)
    if _contradict(automatic, tested):
        sure = min(sure, DISPUTED)
        reasons.insert(1, noted("tests_differ", other=other.reasons[0].message))
    if automatic.verdict is Verdict.OSCILLATING:
        reasons.append(automatic.reasons[0])
    return replace(first, reasons=tuple(reasons), confidence=sure)


def _joined(f: Findings, c: Confirmation) -> bool:
    """Do the test in manual and normal operation see the same dead band, each with too little evidence alone?"""
    other = f.confirmation
    if not isinstance(other, Confirmation) or f.limits:
        return False
    lacking = {note.code for one in (c, other) for note in weigh(one, output_step=f.output_step).against}
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
    if f.blocking:
        return Decision(Verdict.CANNOT_TELL, f.blocking, 0.0, f.cluster)
    if isinstance(f.confirmation, Confirmation):
        return _from_confirmation(f, f.confirmation)
    if f.swinging:
        return Decision(Verdict.OSCILLATING, f.swinging, 0.8, f.cluster)
    if f.confirmation is not None:
        verdict = Verdict.INSUFFICIENT_DATA if f.confirmation.code == TOO_LITTLE else Verdict.CANNOT_TELL
        return Decision(verdict, (f.confirmation,), 0.0, f.cluster)
    # without a test of PV against OP: what the half periods alone allow, by the paper's idea
    if f.long_half_periods == 0:
        if f.watched < SUPERVISION:
            few = noted("few_half_periods", watched=f.watched, least=SUPERVISION)
            return Decision(Verdict.INSUFFICIENT_DATA, (few,), 0.0, f.cluster)
        return Decision(Verdict.NO_BACKLASH, (noted("no_long_half_periods"),), 0.5, f.cluster)
    if f.tight is not None and f.tight.d > 1.0:
        return Decision(Verdict.CANNOT_TELL, (noted("impossible_size", detections=f.tight.n, d=f.tight.d),), 0.0, None)
    if f.tight is not None:
        agree = noted("estimates_agree", n=f.tight.n, detections=f.detections, d=f.tight.d)
        return Decision(Verdict.SUSPECTED, (agree, *f.reading), 0.5, f.cluster)
    return Decision(Verdict.CANNOT_TELL, (noted("estimates_scatter", detections=f.detections),), 0.0, f.cluster)


def _from_confirmation(f: Findings, c: Confirmation) -> Decision:
    weighed, limits, of, codes = weigh(c, output_step=f.output_step), f.limits, f.cluster, {n.code for n in f.quality}
    imitated = float(c.details.get("imitation", 0.0)) / max(float(c.details.get("gain", 0.0)), 1e-9)
    evidence, origin = float(c.details["evidence"]), said(f"of_output:{c.details['output']}")
    sure = confidence(evidence / (DOUBLED if limits else 1.0), by_hand(c), imitated)
    agree = f.tight is not None and abs(f.tight.d - c.d) <= AGREE * c.d
    foreign = () if codes & BLURRED else tuple(filter(contradicts, limits))  # of another OP both methods may err
    reasons = [_explained(c), noted("play_or_stiction")]
    if of is not None and of.n >= ENOUGH:
        reasons.append(noted("methods_agree" if agree else "methods_differ",
                             {"published": of.d, "confirmed": c.d, "n": float(of.n)}))
    reasons += f.reading
    # the number to report; what was found was seen: a limit above it would say that it cannot have been
    size = Cluster(c.d, c.ci95, (c.ci95[1] - c.ci95[0]) / (2.0 * c.d) if c.d > 0 else 0.0, of.n if of else 0,
                   of.share if of else 0.0, c.limit_of_detection and min(c.limit_of_detection, c.d))
    if weighed.clear:
        known = c.details["output"] == "completed" and evidence > DOUBLED * CALLED and all(
            note.code == "interpolated" for note in limits)
        if limits and (foreign or not agree) and not known:
            return Decision(Verdict.SUSPECTED, (reasons[0], *limits, *reasons[1:]), 0.5, size)
        return Decision(Verdict.BACKLASH, (*reasons, *f.swinging), sure, size)
    none = noted("play_does_not_fit", {"evidence": evidence}, origin=origin)
    if f.swinging:
        found = reasons[0] if weighed.some else none
        return Decision(Verdict.OSCILLATING, (*f.swinging, found, *weighed.against), 0.7, None)
    if weighed.some:
        return Decision(Verdict.SUSPECTED, (*reasons, *weighed.against), min(sure, 0.75), size)
    span, limit = float(c.details["output_range"]), c.limit_of_detection
    if c.details["trace"]:
        trace = noted("not_separable", {"d": c.d, "evidence": evidence})
        return Decision(Verdict.CANNOT_TELL, (trace,), 0.0, None)
    if foreign:
        return Decision(Verdict.CANNOT_TELL, foreign, 0.0, None)
    coarse = tuple(note for note in f.quality if note.code in COARSE)
    if limit is None or limit > (CLEARED_TESTED if by_hand(c) else CLEARED) or codes & BLIND:
        values, what = ({}, "no size") if limit is None else ({"limit": limit}, f"only {100 * limit:.2g} % and more")
        few = noted("little_information", {"output_range": span, **values}, what=what)
        return Decision(Verdict.CANNOT_TELL, (*coarse, few), 0.0, None)
    seen = noted("limit_of_detection", {"limit": limit})
    others = () if f.tight is None else (noted("half_periods_only", {"published": f.tight.d}, n=f.tight.n),)
    return Decision(Verdict.NO_BACKLASH, (none, seen, *others), 0.6 if limits else HEALTHY,
                    Cluster(0.0, (0.0, limit), 0.0, 0, 0.0, limit))


def _explained(c: Confirmation) -> Note:
    evidence, crossings = float(c.details["evidence"]), float(c.details["crossings"])
    # three and six times what is asked for at least are clear and strong
    strength = "strong" if evidence > 6 * CALLED else "clear" if evidence > 3 * CALLED else "some"
    low, high = c.ci95
    return noted("play_fits", {"d": c.d, "evidence": evidence, "crossings": crossings}, low=100 * low, high=high,
                 strength=strength, times=times(crossings), origin=said(f"of_output:{c.details['output']}"))
