"""What counts as evidence: the rules on a Confirmation, each with its origin.

EVIDENCE, EVIDENCE_PER_STEP and DOUBT were chosen on 890 loops simulated at random: processes of the Åström-Hägglund
test batch, nine kinds of load and setpoint motion, dead bands 0 to 8 %. tests/benchmarks/detect_benchmark.py draws
other loops of that kind from the simulator and prints what the limits reach there. RESPONDS, KNOWN and ASKED
are set by judgement and were not swept.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..record import Note
from ..results import Confirmation

EVIDENCE = 8.0  # nats; 2 of 197 simulated healthy loops with load steps, drift or noise went beyond 6, none beyond 8
EVIDENCE_PER_STEP = 1.0  # nats more for every load step found: each leaves the transient of an imperfect model
EVIDENCE_OF_SWITCHING = 25.0  # nats more where the load switches to and fro: 5 of 107 such healthy loops went beyond
COARSE_FOR_SWITCHING = 10.0  # samples per Ti; below, twice the evidence: 4 of those 5, rows of one or two samples
SMALLEST = 0.0024  # span: the lowest width of the scan and its neighbourhood are no finding
COARSE = 4.0  # samples per Ti; below, twice the evidence: at 4.5 none of 193 healthy loops needs it, at 3.5 one does
RESPONDS = 20.0  # nats by which OP explains PV: below, nothing can be said about a dead band between them
DOUBT = 4.0  # nats; above, a loop is not called healthy: 1 simulated loop of 100 with d of 1 % or more stays below
MOTION = 1.5  # range of OP over a dead band that it can show
ASKED = 0.03  # dead band a record should show before it may be called healthy: the usual limit without positioner
KNOWN = 0.6  # half interval over d; beyond, the ends differ by a factor of four and nobody can act on the size
OUTPUT_STEPS = 2.5  # a dead band below this many rounding steps of OP is not seen in OP


@dataclass(frozen=True)
class Reading:
    """A Confirmation judged. clear: all rules hold. some: there is evidence, but a rule speaks against it."""

    clear: bool
    some: bool
    needed: float
    against: tuple[Note, ...] = ()


def read(c: Confirmation, *, samples_per_Ti: float, output_step: float = 0.0) -> Reading:
    """Judge the evidence in a confirmation; the notes say which rule does not hold."""
    gain, steps = float(c.details["evidence"]), float(c.details["steps"])
    switches = float(c.details.get("load_half_period_s", 0.0)) > 0.0
    needed = EVIDENCE + EVIDENCE_PER_STEP * steps + EVIDENCE_OF_SWITCHING * switches
    if samples_per_Ti < (COARSE_FOR_SWITCHING if switches else COARSE):
        needed *= 2.0
    against = []
    if gain <= needed:
        against.append(Note("weak_evidence", f"evidence for it is {gain:.3g} nats, {needed:.3g} are asked for"
                            + (f" with {steps:.0f} load steps in the record" if steps else ""),
                            {"evidence": gain, "needed": needed}))
    if float(c.details["half"]) >= gain:
        against.append(Note("half_fits_as_well", "half of that dead band explains PV as well: an error of the process "
                            "model is as likely as a dead band"))
    if c.d < SMALLEST:
        against.append(Note("below_smallest", f"a dead band below {100 * SMALLEST:.2g} % of span is not told from "
                            "an error of the process model"))
    if c.ci95[1] - c.ci95[0] > 2.0 * KNOWN * c.d:
        against.append(Note("size_unknown", f"its size is not known: {100 * c.ci95[0]:.2g} to {100 * c.ci95[1]:.2g} %; "
                            "a record with more motion of OP would narrow it"))
    if output_step and c.d < OUTPUT_STEPS * output_step:
        against.append(Note("below_rounding", f"OP is recorded in steps of {100 * output_step:.2g} %: too coarse for a "
                            f"dead band of {100 * c.d:.2g} %"))
    return Reading(not against, gain > EVIDENCE and c.d >= SMALLEST, needed, tuple(against))


def follows(c: Confirmation) -> bool:
    """True when PV follows OP at all: the output crossed whatever gap there is."""
    return float(c.details["responds"]) > RESPONDS
