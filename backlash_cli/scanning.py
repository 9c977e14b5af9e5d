"""From the samples of a loop to its report: blocks into a LoopScanner, then every question that a record can answer."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from .estimator.carry import carry_of, pack
from .estimator.compensator import recommend
from .estimator.confirm import confirm, manual_stretches
from .estimator.diagnosis import repeats, with_oscillation
from .estimator.haegglund import DEFAULT_KP, INCOMPLETE, detect_oscillation, error_scanner, estimate, tally
from .estimator.identify import identify, with_constant_setpoint
from .estimator.quality import data_quality
from .estimator.reading import read_half_periods
from .estimator.settings_check import check_settings, clocks, contradicts, follows
from .estimator.survey import MOST, Survey
from .estimator.verdict import SWINGING, Findings, decide
from .half_periods import ErrorScanner
from .record import Frozen, LoopSettings, Note, Record, SampleState
from .results import Confirmation, LoopReport, Verdict
from .words import WORDS, noted

DIAGNOSED = 1 << 20  # samples of an oscillation that are looked at, the last ones
FEWEST = 10  # usable samples of which anything can be said
UNUSABLE = {code.partition(":")[0] for state, code in WORDS["samples"].values() if state != "FILLED"} | {
    "op_outside", "outside_range", "not_numbers", "bad_quality"}  # notes that may say why no sample can be used
BY_LAW = 0.9  # of OP that a controller's law explains in manual: no operator moves it so
COARSEST = 0.5  # largest sampling interval in integral times: half periods need points


class ScanOptions(Frozen):
    """What a scan does: `confirm` runs the test of PV against OP through a dead band; `carry` keeps what the next
    night needs to go on with the half period that is open at the end (for a history)."""

    confirm: bool = True
    carry: bool = False


class LoopScanner:
    """Takes the blocks of one loop's record in time order, `update` by `update`, and `finish`es with the report.

    A record cut into blocks anywhere gives the same report, rounding aside. Half periods and counts are of all samples;
    everything else is asked of those that are kept, the last four million (one million without the test of PV against
    OP). A setpoint or settings not given are read from the samples as soon as so many were taken, or at the end."""

    def __init__(self, loop: str, settings: LoopSettings, start: float, interval: float,
                 options: ScanOptions | None = None) -> None:
        self.loop, self.settings, self.start, self.interval = loop, settings, start, interval
        self.options = options or ScanOptions()
        self.notes: dict[tuple[str, str], Note] = {}
        self._given = {settings.source.get(name) for name in ("K", "Ti")} == {"metadata"}
        self._survey = Survey(MOST if self.options.confirm else DIAGNOSED)
        self._setpoint: float | None = None  # what is assumed where none was recorded
        self._settled = False
        self._unread: Note | None = None
        self._errors: ErrorScanner | None = None

    def update(self, block: Record) -> None:
        """Take the next block; its index goes on where the last block ended, or later."""
        room = self._survey.most - self._survey.samples
        if not self._settled and 0 < room < len(block):
            self.update(block.slice(0, room))
            block = block.slice(room, len(block))
        if self._setpoint is not None:
            block = replace(block, setpoint=np.full(len(block), self._setpoint),
                            notes=tuple(note for note in block.notes if note.code != "no_setpoint"))
        self._note(*block.notes)
        self._survey.update(block)
        if self._errors is not None:
            self._errors.update(block)
        known = self.settings.K is not None and self.settings.Ti is not None and self._survey.with_setpoint
        if not self._settled and (known or self._survey.samples >= self._survey.most):
            self._settle()

    def _note(self, *notes: Note) -> None:
        for note in notes:
            self.notes.setdefault((note.code, note.message), note)

    def _settle(self) -> None:
        """Read what is not given from the samples taken so far, and begin to cut half periods with it."""
        self._settled = True
        if not self._survey.with_setpoint:
            held = with_constant_setpoint(replace(self._survey.kept, notes=tuple(self.notes.values())))
            if np.isfinite(held.setpoint).any():
                self._setpoint, self.notes = float(held.setpoint[0]), {}
                self._note(*held.notes)
                self._survey = Survey(self._survey.most)
                self._survey.update(held)
        if (self.settings.K is None or self.settings.Ti is None) and self._survey.used >= 2:
            missing = " and ".join(name for name in ("K", "Ti") if getattr(self.settings, name) is None)
            found = identify(self._survey.kept)
            if isinstance(found, Note):
                self._unread = noted("missing_settings", {"why": found.code}, missing=missing, message=found.message)
            else:
                self.settings = used = found.settings(self.settings)
                self._note(noted("identified_settings", missing=missing, K=used.K, Ti=used.Ti), *found.notes)
        if self.settings.K and self.settings.Ti and self.interval <= COARSEST * self.settings.Ti:
            self._errors = error_scanner(self.settings, self.interval, every=False)
            self._errors.update(self._survey.kept)

    def finish(self) -> LoopReport:
        """Return the report of everything taken so far."""
        if not self._settled:
            self._settle()
        survey, record, carry = self._survey, self._survey.kept, None
        if self.options.carry and self._errors is not None and 0 < len(record) == survey.samples:
            carry = pack(carry_of(record, self.settings, self._errors))
        start, end = ((self.start + place * self.interval if survey.samples else None)
                      for place in (survey.first, survey.last))
        report = LoopReport(self.loop, Verdict.CANNOT_TELL, start=start, end=end, samples=survey.samples,
                            interval_s=self.interval, settings=self.settings, carry=carry)
        return with_oscillation(self._judged(report, record), record.slice(-DIAGNOSED, len(record)))

    def _tests(self, record: Record) -> tuple[tuple[Note, ...], Confirmation | Note | None, Confirmation | Note | None]:
        """What is said of the settings, and what PV against OP, and tests of the valve in manual, tell of a gap."""
        settings, used = self.settings, self._survey.used
        if not self.options.confirm:
            return (), None, None
        doubts = (*check_settings(settings, identify(record)), *clocks(record)) if (
            self._given and used and not follows(record, settings)) else ()
        on_settings = tuple(replace(one, values={"effect": "limits" if contradicts(one) else "info", **one.values})
                            for one in doubts if contradicts(one) or one.code != "settings_unchecked")
        confirmation = confirm(record, settings) if used >= 2 else None
        if isinstance(confirmation, Confirmation):
            left_out = float(self._survey.samples - len(record))
            confirmation = replace(confirmation, details={**confirmation.details, "left_out": left_out})
        manual: Confirmation | Note | None = None
        if tests := manual_stretches(record):
            from .model.manual_test import manual_test  # few records hold a test
            by_hand = np.where(record.state == SampleState.MANUAL, SampleState.GOOD, SampleState.MISSING)
            law = identify(replace(record, state=by_hand.astype(np.uint8)))
            if not isinstance(law, Note) and law.r2 > BY_LAW:
                self._note(noted("manual_follows"))
            else:
                manual = manual_test(tests, self.interval, settings.K, settings.Ti)
        return on_settings, confirmation, manual

    def _judged(self, report: LoopReport, record: Record) -> LoopReport:
        """The report with verdict, reasons and sizes; what an oscillation looks like apart."""
        settings, used, refusal = self.settings, self._survey.used, self._refusal()
        on_settings, confirmation, manual = self._tests(record)
        contradictions = tuple(note for note in on_settings if note.values["effect"] == "limits")
        tells = isinstance(manual, Confirmation) or (manual is not None and manual.code == "manual_no_answer")
        warnings = [replace(note, message=note.message.replace("not used", "used for a test of the valve only"))
                    if tells and note.code == "manual" else note for note in self.notes.values()]
        if refusal is not None and not tells and (
                refusal.code == "insufficient_data" or not isinstance(confirmation, Confirmation)):
            few = refusal.code == "insufficient_data" or (
                self._survey.with_setpoint and refusal.values.get("why") == "too_short")
            return replace(report, verdict=Verdict.INSUFFICIENT_DATA if few else Verdict.CANNOT_TELL,
                           reasons=(*contradictions, refusal, *(() if manual is None else (manual,))),
                           warnings=(*warnings, *on_settings))
        quality = data_quality(record, settings.Ti, self._survey)
        if refusal is None:
            if settings.Kp is None:
                settings = settings.with_values("default", Kp=DEFAULT_KP)
                warnings.append(noted("default_kp", Kp=DEFAULT_KP))
            assert self._errors is not None and settings.Ti
            segments = self._errors.smooth.finish()
            half_periods = estimate(segments, self.interval, settings, self.start)
            oscillation = detect_oscillation(self._errors.plain.finish(), self.interval, settings.Ti)
            if oscillation[0] > SWINGING and not repeats(record.slice(-DIAGNOSED, len(record))):
                oscillation = 0.0, 0.0
            cluster, said = read_half_periods(half_periods, segments.setpoint_move, settings, self.interval,
                                              quality.known_noise)
            cut_off = float(half_periods.dt_s[half_periods.why == INCOMPLETE].sum())
            watched = (used * self.interval - cut_off) / settings.Ti
            report = replace(report, **tally(half_periods, self._errors.smooth.left_out, used * self.interval))
        else:
            # an output without an I part may be no controller's: PV in another unit, and noise
            copied = {"effect": "limits"} if refusal.values.get("why") == "integral_part_unseen" else {}
            warnings.append(noted("rule_left_out", {"why": refusal.code, **copied}, message=refusal.message))
            cluster, said, oscillation, watched = None, (), (0.0, 0.0), 0.0
        output_noise, rounding = (quality.op.noise, quality.op.step) if quality.op else (0.0, 0.0)
        on_quality = (*(note for note in warnings if "effect" in note.values), *quality.notes, *on_settings)
        decision = decide(Findings(cluster, report.detections, report.long_half_periods, oscillation, watched,
                                   confirmation, on_quality, rounding, said, manual))
        reasons, compensator = decision.reasons, None
        if decision.verdict is Verdict.CANNOT_TELL:
            others = tuple(reason for reason in reasons if reason not in contradictions)
            blocked = bool(others) and others[0].values.get("effect") == "blocks"
            reasons = (*others, *contradictions) if blocked else (*contradictions, *others)
        elif decision.verdict is Verdict.BACKLASH:
            swings = oscillation[0] > SWINGING and not report.detections
            compensator = recommend(decision.cluster, decision.confirmation, derivative=settings.Td > 0,
                                    output_noise=output_noise, oscillating=swings)
        return replace(report, verdict=decision.verdict, reasons=reasons, confidence=decision.confidence,
                       warnings=(*warnings, *on_settings), settings=settings, cluster=decision.cluster,
                       confirmation=decision.confirmation, compensator=compensator)

    def _refusal(self) -> Note | None:
        """Why half periods say nothing, None where they do."""
        K, Ti, used = self.settings.K, self.settings.Ti, self._survey.used
        if self._unread is not None:
            return self._unread
        if K is None or Ti is None:
            return noted("insufficient_data:settings", used=used)
        if self.interval > COARSEST * Ti:
            return noted("sampling_too_coarse:scan", interval=self.interval, Ti=Ti, most=COARSEST * Ti)
        if used < FEWEST:
            causes = [note.message for note in self.notes.values() if note.code in UNUSABLE]
            return noted("insufficient_data", used=used, of=self._survey.samples,
                         why="; ".join(causes) or "export a longer time")
        return None if self._survey.with_setpoint else noted("no_setpoint")


def scan(record: Record, options: ScanOptions | None = None) -> LoopReport:
    """Analyse one loop's record and return its report."""
    return scan_blocks([record], options)


def scan_blocks(blocks: Iterable[Record], options: ScanOptions | None = None) -> LoopReport:
    """Analyse one loop, of which one block of samples at least is given, in time order, and return its report."""
    scanner: LoopScanner | None = None
    for block in blocks:
        scanner = scanner or LoopScanner(block.loop, block.settings, block.start, block.interval, options)
        scanner.update(block)
    assert scanner is not None
    return scanner.finish()
