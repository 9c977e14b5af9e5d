"""A quick look whether the output follows the control law with the settings given; one fit instead of a search.

    check_quickly(survey, settings) -> notes of check_settings, after the full identification only where it is needed

The limits lie well inside those of settings_check, so that only what is beyond doubt passes; everything else is left
to the full identification.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil, log

import numpy as np

from ..record import LoopSettings, Note
from .control_law import DERIVATIVE, INTEGRAL, PROPORTIONAL, SETPOINT, LawForm, fit_sums, law_sums
from .identify import LEVELS, SLOWER, law_rows, settings_of
from .law_search import SLOWEST, WINDOW, derivative_is_real, window_of
from .settings_check import check_settings
from .survey import Survey

SAME_RATIO = log(1.08)  # of K/Ti; settings_check says nothing up to 1.15
SAME_GAIN = log(1.3)  # of K; settings_check says nothing up to 1.6
EXPLAINED = 0.9  # share of the output's motion
FEWEST_WINDOWS = 3
LEAST_PER_TI = 5.0  # rows per Ti; with fewer the record does not show which part of the newest error OP contains


def check_quickly(survey: Survey, settings: LoopSettings) -> tuple[Note, ...]:
    """Return what is wrong with the settings given, as `check_settings` does; an empty answer means they agree."""
    return () if follows(survey, settings) else check_settings(settings, settings_of(survey))


def follows(survey: Survey, settings: LoopSettings) -> bool:
    """Whether the recorded output is what a controller with these settings makes, within noise and rounding."""
    K, Ti, Tf = settings.K, settings.Ti, settings.filter_time
    if not K or not Ti or Tf is None or Ti < LEAST_PER_TI * survey.interval:
        return False
    level = min(max(ceil(log(Ti / (SLOWEST * survey.interval)) / log(SLOWER)), 0), LEVELS - 1)
    rows = law_rows(survey, level)
    if rows is None or not np.ptp(rows.signals[2]) > 0.0:
        return False
    given_D = (DERIVATIVE,) if settings.Td > 0.0 else ()
    window = window_of(WINDOW * Ti / rows.interval, len(rows.index))
    form = LawForm((PROPORTIONAL, INTEGRAL, SETPOINT, *given_D), window, ceil(5.0 * Tf / rows.interval) + 1, 0,
                   0.5 if level else 0.0)
    sums = law_sums(rows, form, Tf)
    if len(sums) < FEWEST_WINDOWS:
        return False
    fit = fit_sums(sums, form, Tf)
    if fit is None:  # the setpoint stands still, or moved between the windows only
        form = replace(form, terms=(PROPORTIONAL, INTEGRAL, *given_D))
        fit = fit_sums(sums, form, Tf)
    if fit is None or fit.unexplained > 1.0 - EXPLAINED or fit.gain * K <= 0.0 or fit.ratio * K <= 0.0:
        return False
    if abs(log(fit.ratio * Ti / K)) > SAME_RATIO or abs(log(fit.gain / K)) > SAME_GAIN:
        return False
    if given_D:
        Td = fit.values[-1] / fit.gain
        return bool(settings.Td / 1.3 <= Td <= 1.3 * settings.Td)
    with_D = fit_sums(sums, replace(form, terms=(*form.terms, DERIVATIVE)), Tf)
    return with_D is None or not derivative_is_real(with_D, fit)
