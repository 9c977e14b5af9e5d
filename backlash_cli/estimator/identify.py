"""Controller settings read from the record itself: which K, Ti and Td make this output from these signals?

The ideal PID of the paper (2) is linear in K, K/Ti, K Td and the setpoint weight once the measurement filter (3)
is known. It is fitted in its level form, with one offset per window of about ten Ti, so that a recorder's rounding
is averaged out and slow changes from outside do not matter; the filter time is searched for. What the record cannot
settle (filter, scan rate of the controller) widens the intervals.

    identify(record) -> Identification | Note          settings_of(survey) -> the same, after a Survey of all blocks

A Note says why the settings cannot be read: no_output, output_constant, too_short, not_this_controller,
proportional_part_unseen.
An Identification may carry notes: gain_uncertain, sampling_too_coarse, interpolated, one_frequency; `separate` is
False where only K/Ti is to be relied on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..record import Note, Record
from .control_law import LawRows
from .survey import LEVELS, OUTPUT, SLOWER, Survey

if TYPE_CHECKING:
    from .identification import Identification

LEAST_ROWS = 60
MOSTLY_OWN = 0.2  # share of interpolated samples that leaves the P part visible


def identify(record: Record) -> Identification | Note:
    """Read K, Ti, Td and setpoint weight of the controller from setpoint, measurement and output of one loop."""
    survey = Survey(record.interval)
    survey.update(record)
    return settings_of(survey)


def settings_of(survey: Survey) -> Identification | Note:
    """Return the settings that a survey of the whole record shows, or a Note that says why they cannot be read."""
    from .law_search import find_settings

    if not survey.with_output:
        return Note("no_output", "the record has no controller output, so K and Ti cannot be read from it")
    if survey.used and not survey.spread(OUTPUT):
        return Note("output_constant", "the controller output never moves, so K and Ti cannot be read from it")
    finest = law_rows(survey, 0)
    if finest is None:
        return Note(
            "too_short",
            f"fewer than {LEAST_ROWS} usable samples with setpoint, PV and output: K and Ti cannot be read from them",
        )
    found = find_settings(lambda level: law_rows(survey, level) if level else finest, survey.interval)
    if isinstance(found, Note) or survey.used_filled <= MOSTLY_OWN * survey.used:
        return found
    share = survey.used_filled / survey.used
    message = f"{100 * share:.0f} % of the samples are interpolated: only K/Ti is known"
    return replace(found, notes=(*found.notes, Note("interpolated", message, {"share": share})))


def law_rows(survey: Survey, level: int) -> LawRows | None:
    """Return one picture of the record, None where it has too few rows, or there is none so slow."""
    if level >= LEVELS:
        return None
    index, values = survey.rows(level)
    return LawRows(index, values, survey.interval * SLOWER**level) if len(index) >= LEAST_ROWS else None
