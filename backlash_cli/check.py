"""Before any verdict: is the record of each loop good enough, and do its settings agree with the data?"""

from dataclasses import field

import numpy as np

from .estimator.confirm import SHORTEST
from .estimator.diagnosis import Diagnosis, diagnose
from .estimator.identify import Identification, at_mean, identify, with_constant_setpoint
from .estimator.quality import Quality, data_quality, heaviest_first, with_reversals
from .estimator.settings_check import check_settings, clocks, contradicts
from .record import Frozen, LoopSettings, Note, Record, duration
from .words import noted, said

_OF_TI = ("settings_ti_minutes", "settings_ti_repeats", "settings_form", "settings_contradicted")  # Ti is not true then


class LoopCheck(Frozen):
    """What was found about one loop's data and settings. start, end: UTC epoch seconds; signals normalised.

    identified: settings read from the data; unidentified: why not. settings_notes: disagreements. diagnosis: what an
    oscillation looks like. notes: what the loader found or assumed. failure: why the loop was not checked at all."""

    loop: str
    start: float | None = None
    end: float | None = None
    settings: LoopSettings = field(default_factory=LoopSettings)
    quality: Quality | None = None
    identified: Identification | None = None
    unidentified: Note | None = None
    settings_notes: tuple[Note, ...] = ()
    diagnosis: Diagnosis | None = None
    notes: tuple[Note, ...] = ()
    failure: Note | None = None

    @property
    def judged(self) -> Note:
        """What the data mean for the verdict: "none", "limits", "blocks" or "failed", the worst there is, and why."""
        if self.failure is not None:
            return Note("failed", f"not checked: {self.failure.message}")
        quality = heaviest_first((*(n for n in self.notes if "effect" in n.values),
                                  *(self.quality.notes if self.quality else ())))
        heaviest = quality[0].values["effect"] if quality else "info"
        if heaviest == "blocks":
            return Note("blocks", f"no verdict possible: {quality[0].message}")
        if self.unidentified is not None and not (self.settings.K and self.settings.Ti):
            return Note("blocks", f"no verdict possible: K and Ti are not given, and {self.unidentified.message}")
        for note in self.settings_notes:
            if contradicts(note):
                means = "can be suspected at most" if note.code == "settings_unchecked" else "would have a wrong size"
                return Note("limits", f"a dead band {means}: {note.message}")
        if heaviest == "limits":
            return Note("limits", f"a dead band can be suspected at most: {quality[0].message}")
        but = "" if self.diagnosis is None else f", but the loop oscillates; it {said(self.diagnosis.kind)}"
        but = f", but: {self.settings_notes[0].message}" if self.settings_notes else but
        return Note("none", f"fit for a verdict{but}")


def check_loop(record: Record) -> LoopCheck:
    """Judge one loop's data and compare its settings with those that the data show."""
    record = with_constant_setpoint(record)
    found, settings = identify(record), record.settings
    identified, unidentified = (None, found) if isinstance(found, Note) else (found, None)
    Ti, notes = settings.Ti, check_settings(settings, found)
    if identified is not None and (Ti is None or any(n.code in _OF_TI for n in notes)):
        Ti = identified.Ti.value
    diagnosis = diagnose(record if np.isfinite(record.setpoint).any() else at_mean(record) or record)
    first, last = record.time[[0, -1]].tolist() if len(record) else (None, None)
    quality, least = with_reversals(data_quality(record, Ti), record, Ti), SHORTEST * (Ti or 0.0)
    used = quality.usable_share * quality.duration
    short = [noted("short_record", {"effect": "blocks"}, used=duration(used), least=duration(least))] * (used < least)
    return LoopCheck(record.loop, first, last, settings, quality, identified, unidentified, notes,
                     diagnosis if diagnosis.kind != "none" else None, (*record.notes, *clocks(record), *short))
