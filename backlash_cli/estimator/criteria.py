"""What counts as evidence: the rules on a Confirmation, each with its origin.

CALLED, SOME and the table CONFIDENCE come from 1,600 loops of plants that share nothing with the model of the test
(tests/benchmarks/strangers.py; docs/reliability.md): there 2 % of the healthy ones are called. The others
are what evidence means: one event is no proof, and a number that the grid or the record made is not the valve's."""

import numpy as np

from ..record import Frozen, Note
from ..results import Confirmation
from ..words import noted, times

CALLED, CALLED_TESTED = 6.5, 9.0  # nats, in automatic and in a test in manual
SOME = 5.0  # nats: worth a look
ELSEWHERE = 2.0  # nats that a test in manual must bring besides the turn of OP that brings the most
UNKNOWN_SIGN = 3.0  # times as much where K is not known: nothing tells then which answers a process can give
CONFIDENCE = ((5.0, 0.4), (6.5, 0.6), (10.0, 0.8), (15.0, 0.88), (25.0, 0.94), (40.0, 0.97), (70.0, 0.98))
UNLIKE, UNSURE = 0.5, 0.92  # of what a gap explains: where gaps that forget explain more, however much it is
CONFIDENCE_TESTED = ((5.0, 0.80), (9.0, 0.95), (20.0, 0.97))  # the same of tests in manual (strangers --kind manual)
SMALLEST = 0.005  # span: nobody opens a valve for less, and errors of the prediction read as such sizes
MOTION, LEAST_MOTION = 1.5, 1.2  # range of OP over a dead band that it can show; the least, with evidence for three
FEWEST_CROSSINGS = 2  # of the gap, back after forth; from one upset any curve looks like a gap
STEADY = 2.5  # deviations from zero of the share with which PV answers the gap, over stretches of the record
CLEARED, CLEARED_TESTED = 0.02, 0.05  # span: "no backlash, below" is said up to here, of a test in manual up to there
KNOWN = 1.0  # half interval over d; beyond, it reaches down to no dead band at all
OUTPUT_STEPS = 2.5  # a dead band below this many rounding steps of OP is not seen in OP


class Weighed(Frozen):
    """A Confirmation weighed. clear: all rules hold. some: there is evidence, but a rule speaks against it."""

    clear: bool
    some: bool
    against: tuple[Note, ...] = ()


def confidence(evidence: float, tested: bool = False, imitated: float = 0.0) -> float:
    """How often a dead band found with so much evidence [nats] is there, in automatic or in a test in manual. imitated:
    what gaps that forget, as no valve does, explain of what it explains."""
    at, right = zip(*(CONFIDENCE_TESTED if tested else CONFIDENCE), strict=True)
    sure = float(np.interp(np.log(max(evidence, 1.0)), np.log(at), right))
    return min(sure, UNSURE) if imitated > UNLIKE else sure


def by_hand(c: Confirmation) -> bool:
    """Say whether a confirmation comes from a test of the valve in manual."""
    return c.details.get("source") == "manual_test"


def weigh(c: Confirmation, *, output_step: float = 0.0) -> Weighed:
    """Weigh the evidence in a confirmation; the notes say which rule does not hold. output_step: rounding [span]."""
    evidence, moved, crossings = (float(c.details[name]) for name in ("evidence", "output_range", "crossings"))
    times_more = 1.0 if by_hand(c) or c.details["sign_known"] else UNKNOWN_SIGN
    needed = CALLED_TESTED if by_hand(c) else times_more * CALLED
    against = []
    if evidence <= needed:
        against.append(noted("weak_evidence", {"evidence": evidence, "needed": needed}))
    if crossings < FEWEST_CROSSINGS:
        against.append(noted("few_reversals", {"crossings": crossings}, times=times(crossings)))
    elif (float(c.details["elsewhere"]) < ELSEWHERE if by_hand(c) else
          float(c.details["share"]) < STEADY * float(c.details["share_deviation"])):
        against.append(noted("single_event"))
    if moved < (MOTION if evidence < 3.0 * CALLED else LEAST_MOTION) * c.d:
        against.append(noted("little_motion:gap", {"output_range": moved}))
    if c.details["edge"]:
        against.append(noted("edge_of_widths"))
    if c.d < SMALLEST:
        against.append(noted("below_smallest", smallest=SMALLEST))
    if c.ci95[1] - c.ci95[0] > 2.0 * KNOWN * c.d:
        against.append(noted("size_unknown", low=100 * c.ci95[0], high=c.ci95[1]))
    if output_step and c.d < OUTPUT_STEPS * output_step:
        against.append(noted("below_rounding", step=output_step, d=c.d))
    return Weighed(not against, evidence > times_more * SOME and c.d >= SMALLEST, tuple(against))
