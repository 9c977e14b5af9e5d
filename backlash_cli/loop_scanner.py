"""Blocks of one loop's samples in, its LoopReport out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from .estimator.carry import CarryRecorder
from .estimator.carry_bytes import pack
from .estimator.compensator import recommend
from .estimator.haegglund import DEFAULT_KP, ErrorScanner, error_scanner, estimate, no_half_periods
from .estimator.identify import settings_of
from .estimator.law_check import check_quickly
from .estimator.oscillation import Oscillation, detect_oscillation
from .estimator.quality import quality_of
from .estimator.reading import Reading, known_noise, read_half_periods
from .estimator.survey import Survey
from .estimator.survey_walk import FIRST, LAST, WITH_SETPOINT
from .estimator.tally import tally_of
from .estimator.verdict import Findings, decide
from .record import LoopSettings, Note, Record, SampleState
from .results import Confirmation, LoopReport, Verdict

if TYPE_CHECKING:
    from .estimator.confirm import ConfirmationScanner
    from .estimator.manual_stretches import ManualScanner

OSCILLATING = 0.5  # share of the record; with no half period of 5 Ti it is a limit cycle, which no gain heals
COARSEST = 0.5  # largest sampling interval in integral times: half periods need points


@dataclass(frozen=True)
class ScanOptions:
    """What a scan does: `confirm` runs the test of PV against OP through a dead band; `carry` keeps what the next
    night needs to go on with the half period that is open at the end (for a history)."""

    confirm: bool = True
    carry: bool = False


class LoopScanner:
    """Takes the blocks of one loop's record in time order, `update` by `update`, and `finish`es with the report.

    A record cut into blocks anywhere gives the same report as the whole record, rounding aside. Kept between blocks:
    filter states, the open half period, the half periods that an estimate or the oscillation detector can use, and
    sums; not the samples. Only where K or Ti are not known the blocks are kept until the end: they must be read from
    the whole record before the first half period can be judged. With keep=False they are not, and the caller gives
    all blocks once more to the scanner that `second_pass` returns.
    """

    def __init__(self, loop: str, settings: LoopSettings, start: float, interval: float,
                 options: ScanOptions | None = None, *, keep: bool = True) -> None:
        self.loop, self.settings, self.start, self.interval = loop, settings, start, interval
        self.options = options or ScanOptions()
        self.notes: dict[tuple[str, str], Note] = {}
        self._unknown = settings.K is None or settings.Ti is None
        self._kept: list[Record] | None = [] if self._unknown and keep else None
        self._errors: ErrorScanner | None = None
        self._carry: CarryRecorder | None = None
        self._confirm: ConfirmationScanner | None = None
        given = {settings.source.get(name) for name in ("K", "Ti")} == {"metadata"}
        self._check = self.options.confirm and given
        self._survey = Survey(interval, slower=self._check or self._unknown)
        self._surveyed = False
        self._unread: Note | None = None
        if settings.K and settings.Ti and interval <= COARSEST * settings.Ti:
            self._errors = error_scanner(settings, interval, every=False)
            self._carry = CarryRecorder(settings, interval) if self.options.carry else None
        self._manual: ManualScanner | None = None
        if self.options.confirm:
            self._confirm, self._manual = _tests(settings, interval)

    def update(self, block: Record) -> None:
        """Take the next block; its index goes on where the last block ended, or later."""
        for note in block.notes:
            self.notes.setdefault((note.code, note.message), note)
        if not len(block):
            return
        if not self._surveyed:
            self._survey.update(block)
        if self._kept is not None:
            self._kept.append(block)
        if self._errors is not None:
            self._errors.update(block)
        if self._carry is not None:
            self._carry.update(block)
        if self._confirm is not None and self._manual is not None:
            self._confirm.update(block)
            self._manual.update(block)

    @property
    def has_setpoint(self) -> bool:
        """Whether a setpoint was recorded with any sample taken so far."""
        return bool(self._survey.numbers[WITH_SETPOINT])

    @property
    def used(self) -> int:
        """Number of samples taken so far that may enter an estimate."""
        return sum(self._survey.states[: SampleState.FILLED + 1].tolist())

    def second_pass(self) -> LoopScanner | None:
        """Return the scanner that all blocks must be given to once more, None where `finish` can answer now.

        Needed where K or Ti are not given and have been read from the blocks.
        """
        if not self._unknown or self.used < 2:
            return None
        found = settings_of(self._survey)
        missing = " and ".join(name for name in ("K", "Ti") if getattr(self.settings, name) is None)
        if isinstance(found, Note):
            self._unread = Note(
                "missing_settings", f"{missing} not given, and not to be read from the data: {found.message};"
                " give K and Ti in the loops file", {"why": found.code})
            return None
        self._confirm = self._manual = None  # the samples that they hold are given to the second scanner once more
        scanner = LoopScanner(self.loop, found.settings(self.settings), self.start, self.interval, self.options)
        scanner._survey, scanner._surveyed = self._survey, True
        used = scanner.settings
        message = f"{missing} not given; read from the data: K = {used.K:.3g}, Ti = {used.Ti:.3g} s"
        for note in (*self.notes.values(), Note("identified_settings", message), *found.notes):
            scanner.notes[(note.code, note.message)] = note
        return scanner

    def finish(self) -> LoopReport:
        """Return the report of everything taken so far."""
        if self._kept is not None:
            scanner = self.second_pass()
            if scanner is not None:
                for block in self._kept:
                    scanner.update(block)
                return scanner.finish()
        settings, on_settings = self.settings, self._settings_notes()
        warnings: list[Note] = []
        refusal = self._refusal()
        confirmation = self._confirm.finish() if self._confirm and self.used >= 2 else None
        manual = self._tested()
        tells = isinstance(manual, Confirmation) or (manual is not None and manual.code == "manual_no_answer")
        if tells:
            for key in [key for key in self.notes if key[0] == "manual"]:
                message = key[1].replace("not used", "used for a test of the valve only")
                self.notes[key] = replace(self.notes[key], message=message)
        if refusal is not None and not tells and (
                refusal.code == "insufficient_data" or not isinstance(confirmation, Confirmation)):
            missing = (refusal,) if manual is None or isinstance(manual, Confirmation) else (refusal, manual)
            short = self.has_setpoint and refusal.values.get("why") == "too_short"
            few = short or refusal.code == "insufficient_data"
            return self._report(Verdict.INSUFFICIENT_DATA if few else Verdict.CANNOT_TELL,
                                (*_contradictions(on_settings), *missing), 0.0, on_settings, carry=self._packed())
        if refusal is None:
            assert self._errors is not None and self.settings.Ti is not None
            if settings.Kp is None:
                settings = settings.with_values("default", Kp=DEFAULT_KP)
                warnings.append(Note("default_kp", f"Kp is not given; the paper's default {DEFAULT_KP} is used"))
            half_periods = estimate(self._errors.smooth.finish(), self.interval, settings)
            left_out = self._errors.smooth.left_out
            oscillation = detect_oscillation(self._errors.plain.finish(), self.interval, self.settings.Ti)
        else:
            warnings.append(Note("rule_left_out", "the published rule (15) on half periods is left out: "
                                 + refusal.message, {"why": refusal.code}))
            half_periods, left_out = no_half_periods(), 0
            oscillation = Oscillation(False, 0.0, 0.0)
        quality = quality_of(self._survey, self.settings.Ti)
        noise = known_noise(quality.pv, quality.filled_share)
        reading = (Reading(half_periods, None) if refusal is not None else
                   read_half_periods(half_periods, settings, self.interval, noise))
        tally = tally_of(half_periods, left_out)
        accepted = tally.accepted
        rounding = quality.op.step if quality.op else 0.0
        warnings += on_settings
        decision = decide(Findings(reading.cluster, accepted, tally.long, oscillation, confirmation,
                                   (*quality.notes, *on_settings), rounding, reading.notes, manual))
        if decision.verdict is Verdict.CANNOT_TELL:
            decision = replace(decision, reasons=(*_contradictions(on_settings), *decision.reasons))
        compensator = None
        if decision.verdict is Verdict.BACKLASH:
            output_noise = quality.op.noise if quality.op else 0.0
            compensator = recommend(decision.cluster, decision.confirmation, derivative=settings.Td > 0,
                                    output_noise=output_noise,
                                    oscillating=oscillation.share > OSCILLATING and not accepted)
        return self._report(decision.verdict, decision.reasons, decision.confidence, warnings=tuple(warnings),
                            settings=settings, cluster=decision.cluster, confirmation=decision.confirmation,
                            compensator=compensator,
                            carry=self._packed(),
                            **tally.of_report(half_periods, self.start, self.used * self.interval))

    def _packed(self) -> bytes | None:
        """What the next night needs to go on from here, also where this one is too short to be judged."""
        return pack(self._carry.finish(self._errors)) if self._carry and self._errors else None

    def _tested(self) -> Confirmation | Note | None:
        """What tests of the valve in manual say, None where there were none."""
        tests = self._manual.finish() if self._manual else []
        if not tests:
            return None
        from .model.manual_test import manual_test  # few records hold a test

        return manual_test(tests, self.interval, self.settings.K, self.settings.Ti)

    def _settings_notes(self) -> tuple[Note, ...]:
        """Say where the settings given do not make the recorded output; a contradiction limits the verdict."""
        if not (self._check and self.used):
            return ()
        notes = []
        for note in check_quickly(self._survey, self.settings):
            if note.code != "settings_unchecked":
                effect = "limits" if note.values.get("severity") == "contradict" else "info"
                notes.append(replace(note, values={**note.values, "effect": effect}))
        return tuple(notes)

    def _refusal(self) -> Note | None:
        if self._unread is not None:
            return self._unread
        if self.settings.K is None or self.settings.Ti is None:
            return Note("insufficient_data", f"only {self.used} usable samples, and K or Ti are not known")
        if self.interval > COARSEST * self.settings.Ti:
            return Note("sampling_too_coarse", f"sampled every {self.interval:g} s, too coarse for Ti = "
                        f"{self.settings.Ti:g} s; at most {COARSEST * self.settings.Ti:g} s are needed")
        if self.used < 2:
            return Note("insufficient_data", f"only {self.used} usable samples")
        if not self.has_setpoint:
            return Note("no_setpoint", "no setpoint (SP) in the data: without it there is no control error to judge")
        return None

    def _report(self, verdict: Verdict, reasons: tuple[Note, ...], confidence: float,
                warnings: tuple[Note, ...] = (), settings: LoopSettings | None = None, **rest: object) -> LoopReport:
        first, last = self._survey.numbers[[FIRST, LAST]].tolist()
        samples = sum(self._survey.states.tolist())
        return LoopReport(
            self.loop, verdict, reasons, confidence,
            start=self.start + first * self.interval if samples else None,
            end=self.start + last * self.interval if samples else None,
            samples=samples, interval_s=self.interval, settings=settings or self.settings,
            warnings=(*self.notes.values(), *warnings), **rest,  # type: ignore[arg-type]
        )


def _tests(settings: LoopSettings, interval: float) -> tuple[ConfirmationScanner, ManualScanner]:
    from .estimator.confirm import ConfirmationScanner  # not worth loading where nobody asks for it
    from .estimator.manual_stretches import ManualScanner

    return ConfirmationScanner(settings, interval), ManualScanner()


def _contradictions(notes: tuple[Note, ...]) -> tuple[Note, ...]:
    return tuple(note for note in notes if note.values.get("effect") == "limits")
