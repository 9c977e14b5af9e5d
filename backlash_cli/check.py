"""Before any verdict: is the record of each loop good enough, and do its settings agree with the data?"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from .errors import BacklashError
from .estimator.diagnosis import WORDS, Diagnosis, diagnose
from .estimator.identify import Identification, at_mean, identify, with_constant_setpoint
from .estimator.quality import Quality, data_quality
from .estimator.settings_check import check_settings
from .record import LoopSettings, Note, Record
from .results import PlantResult

# after these the given Ti is no measure for the sampling
_OF_TI = ("settings_ti_minutes", "settings_ti_repeats", "settings_form", "settings_contradicted")


@dataclass(frozen=True)
class LoopCheck:
    """What was found about one loop's data and settings. start, end: UTC epoch seconds; signals normalised.

    identified: settings read from the data; unidentified: why they cannot be. settings_notes: disagreements.
    diagnosis: what an oscillation looks like, None where there is none. notes: what the loader found or assumed.
    failure: why the loop could not be checked at all; quality and identified are None then.
    """

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
    def effect(self) -> str:
        """What it all means for a verdict: "none" (nothing in its way), "limits", "blocks" or "failed"."""
        return self._judged()[0]

    @property
    def meaning(self) -> str:
        """One sentence on what it means for the verdict on backlash."""
        return self._judged()[1]

    def _judged(self) -> tuple[str, str]:
        """Effect and meaning: the first of what stands in the way, the worst first."""
        if self.failure is not None:
            return "failed", f"not checked: {self.failure.message}"
        quality = () if self.quality is None else self.quality.notes
        for note in quality:
            if note.values.get("effect") == "blocks":
                return "blocks", f"no verdict possible: {note.message}"
        if self.unidentified is not None and not (self.settings.K and self.settings.Ti):
            return "blocks", f"no verdict possible: K and Ti are not given, and {self.unidentified.message}"
        for note in self.settings_notes:
            if note.values.get("severity") == "contradict":
                return "limits", f"the size of a dead band would be wrong: {note.message}"
        if self.quality is not None and self.quality.effect == "limits":
            return "limits", f"a dead band can be suspected at most: {quality[0].message}"
        for note in self.settings_notes:
            return "none", f"fit for a verdict, but: {note.message}"
        if self.diagnosis is not None:
            return "none", f"fit for a verdict, but the loop oscillates; it {WORDS[self.diagnosis.kind]}"
        return "none", "fit for a verdict"


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
    return LoopCheck(record.loop, first, last, settings, data_quality(record, Ti), identified, unidentified, notes,
                     diagnosis if diagnosis.kind != "none" else None, record.notes)


def check(plant: Iterable[Record], progress: Callable[[], None] | None = None) -> PlantResult:
    """Check every loop; one that fails is reported as failed and the others go on. `progress` is called after each."""
    loops = []
    for record in plant:
        try:
            loops.append(check_loop(record))
        except Exception as error:  # one loop's failure must not cost the others their report
            why = Note(error.code, str(error)) if isinstance(error, BacklashError) else Note(
                "internal_error", f"the check failed: {type(error).__name__}: {error}")
            loops.append(LoopCheck(record.loop, notes=record.notes, failure=why))
        if progress is not None:
            progress()
    failures: tuple[Note, ...] = getattr(plant, "failures", ())
    lost = {str(note.values["loop"]): note for note in reversed(failures) if note.values.get("loop")}
    known = {loop.loop for loop in loops}
    loops += [LoopCheck(name, failure=note) for name, note in reversed(lost.items()) if name not in known]
    rest = tuple(note for note in failures if not note.values.get("loop"))
    return PlantResult(tuple(loops), getattr(plant, "inputs", ()), getattr(plant, "warnings", ()), rest)
