"""Do the controller settings of the metadata make the recorded output? If not: which usual mix-up of units would?

The comparison rests on K/Ti, which a record settles to a few per cent; K and Ti apart are used to tell the mix-ups
from each other. The codes are explained in docs/settings.md; each has `values` "factor" (K/Ti as given over as
identified), "K" and "Ti" (as identified, in the units of the record), and "severity" ("warn": up to 1.5, "contradict":
beyond, the size of a dead band is wrong by that factor)."""

from dataclasses import replace
from math import ceil, exp, log

import numpy as np
import scipy

from ..record import Frozen, LoopSettings, Note, Record
from ..words import noted, said
from .control_law import DERIVATIVE, INTEGRAL, PROPORTIONAL, SETPOINT, LawForm, fit_law
from .identify import SLOWEST, WINDOW, Identification, Identified, law_rows, window_of
from .survey import LEVELS, SLOWER

AGREES = log(1.15)  # findings: K/Ti is identified to 4-8 % in nine loops of ten
SURE = log(1.05)  # by so much at least the interval must lie away from the value given
WELL_KNOWN = 0.08  # half width of the interval of K/Ti above which only gross differences count
CONTRADICTS = log(1.5)
EXPLAINED = log(1.3)  # how well a mix-up has to explain the factor
CLOSE = log(1.1)  # a difference that is that of the spans is believed where K/Ti is known less well
COARSE = 1.5  # Ti in samples below which only a plain mix-up of units can be seen, if the data show none well above
LARGE = log(3.0)  # a smaller factor that comes out of the values by accident is not a mix-up
GAIN_APART = log(1.6)  # K alone is known less well than K/Ti
# The limits of the quick look lie well inside those of the full comparison, to which everything in doubt is left.
SAME_RATIO, SAME_GAIN = 1.08, 1.3  # of K/Ti; of K and Td
UNEXPLAINED, FEWEST_WINDOWS = 0.1, 3  # share of OP's motion; of them at least
# Of 428 loops of four plants the noise of PV lies in OP 1 sample early to 3 late, or correlates by less than 0.26.
RECENT, FARTHEST, EARLY, LATE, PLAIN = 1 << 15, 1000, -2, 6, 0.5  # samples; correlation that is no accident
LEAST_PER_TI = 5.0  # rows per Ti; with fewer the record does not show which part of the newest error OP contains


class MixUp(Frozen):
    """A usual mistake: settings as given = those of the controller times these factors."""

    code: str
    gain: float
    reset: float
    words: str
    known: bool = False  # the factor follows from the spans alone, so a small one is no accident


def check_settings(settings: LoopSettings, found: Identification | Note) -> tuple[Note, ...]:
    """Compare K, Ti and Td of the metadata with those read from the record; an empty answer means they agree."""
    K, Ti = (None if settings.source.get(name) in ("identified", "data") else getattr(settings, name) or None
             for name in ("K", "Ti"))
    if K is None and Ti is None:
        return ()
    if isinstance(found, Note):  # whose controller it is not, that moves no valve of this loop
        seen = (Ti or 0.0) > COARSE * float(found.values.get("interval", np.inf))  # an I part would have been
        severity = {"severity": "contradict"} if seen or found.code == "not_this_controller" else {}
        return (noted("settings_unchecked", {"why": found.code, **severity}, message=found.message),)
    notes = []
    if K is not None and K * found.K.value < 0 and all(x.ci95[0] * x.ci95[1] > 0 for x in (found.K, found.ratio)):
        action = "reverse (K positive)" if found.K.value > 0 else "direct (K negative)"
        notes.append(noted("settings_action_sign", _values(found, -1.0, "contradict"), given=K, action=action))
    notes += _compared(K, Ti, settings, found)
    low, high = found.Td.ci95
    # only where the data show a D part: its absence cannot be told from a filter
    if found.Td.value > 0 and not low / 1.5 <= settings.Td <= high * 1.5:
        notes.append(noted("settings_derivative", {"Td": found.Td.value, "severity": "warn"}, given=settings.Td,
                           low=low, high=high))
    return tuple(notes)


def contradicts(note: Note) -> bool:
    """Whether the size of a dead band is wrong, or the dead band none, if this is so."""
    return note.values.get("severity") == "contradict"


def follows(record: Record, settings: LoopSettings) -> bool:
    """Whether one fit of the law explains the recorded output and gives the settings back: it takes a twentieth of the
    search of `identify`, and what it accepts `check_settings` would accept."""
    K, Ti, Td, Tf = settings.K, settings.Ti or 0.0, settings.Td, settings.filter_time or 0.0
    level = min(max(ceil(log(max(Ti / record.interval, 1.0) / SLOWEST) / log(SLOWER)), 0), LEVELS - 1)
    rows = law_rows(record, level) if K and Ti >= LEAST_PER_TI * record.interval else None
    if not K or rows is None:
        return False
    window, settle = window_of(WINDOW * Ti / rows.interval, len(rows.index)), ceil(5.0 * Tf / rows.interval) + 1
    form = LawForm((PROPORTIONAL, INTEGRAL, SETPOINT, DERIVATIVE), window, settle, 0, 0.5 if level else 0.0)
    fit = fit_law(rows, form, Tf)  # None: the setpoint stands still, or moved between the windows only
    fit = fit or fit_law(rows, replace(form, terms=(PROPORTIONAL, INTEGRAL, DERIVATIVE)), Tf)
    if fit is None or len(fit.sums) < FEWEST_WINDOWS or fit.unexplained > UNEXPLAINED:
        return False
    found = fit.values[-1] / fit.gain
    same = SAME_GAIN * min(found, Td) >= max(found, Td) if Td else found <= max(2.0 * Tf, 0.02 * Ti)
    return bool(same and all(1.0 / most <= times <= most for times, most in (
        (fit.values[1] * Ti / K, SAME_RATIO), (fit.gain / K, SAME_GAIN))))


def clocks(record: Record) -> tuple[Note, ...]:
    """Say where OP answers PV before PV shows it, or long after: the tags have different clocks.

    Second differences leave the noise of PV, and a controller answers that at once, by -K times it, whatever the
    process does. So their correlation stands out at one distance in time, which is a sample or two at most, or
    several where the controller works more slowly than it is recorded. Nothing is said where no noise is seen in OP."""
    last = record.slice(max(len(record) - RECENT, 0), len(record))
    if not last.settings.K or last.output is None or len(last) < RECENT // 64:
        return ()
    bent, use = np.diff([last.measurement, last.output], 2), last.usable
    kept = use[2:] & use[1:-1] & use[:-2] & (last.index[2:] - last.index[:-2] == 2) & np.isfinite(bent).all(0)
    pv, op = np.where(kept, bent, 0.0)
    middle = slice(max(len(pv) - 1 - FARTHEST, 0), len(pv) + FARTHEST)
    seen = -np.sign(last.settings.K) * scipy.signal.correlate(op, pv, method="fft")[middle]
    most, centre = float(seen.max()), min(FARTHEST, len(pv) - 1)
    late = int(np.argmax(seen)) - centre
    usual = seen[centre + EARLY + 1 : centre + LATE].max()  # as large in a swing of few samples
    if EARLY < late < LATE or most <= max(PLAIN * float(np.sqrt((pv @ pv) * (op @ op))), 2.0 * usual, 0.0):
        return ()
    apart: dict[str, float | str] = {"effect": "blocks", "seconds": late * last.interval}
    return (noted("clocks_differ", apart, apart=abs(late) * last.interval, when="before" if late < 0 else "after"),)


def _magnitude(x: Identified) -> Identified:
    ends = sorted(abs(v) for v in x.ci95)
    return Identified(abs(x.value), (0.0 if x.ci95[0] * x.ci95[1] <= 0 else ends[0], ends[1]))


def _distance(given: float, x: Identified) -> tuple[float, float]:
    """Logarithm of given / identified, and its distance from 0 that the interval leaves no doubt about."""
    nearest = log(given / min(max(given, x.ci95[0]), x.ci95[1])) if x.ci95[1] > 0 else 0.0
    return log(given / x.value), abs(nearest)


def _values(found: Identification, factor: float, severity: str) -> dict[str, float | str]:
    return {"factor": factor, "K": found.K.value, "Ti": found.Ti.value, "severity": severity}


def _times(offset: float) -> str:
    return f"{exp(offset):.3g} times" if offset > 0 else f"1/{exp(-offset):.3g} of"


def _compared(K: float | None, Ti: float | None, settings: LoopSettings, found: Identification) -> list[Note]:
    """What is wrong with K and Ti; of one that is not given that of the data is taken, and its doubt."""
    gain, reset, ratio = _magnitude(found.K), found.Ti, _magnitude(found.ratio)
    if K is None:
        low, high = (max(end, 1e-9) for end in reset.ci95)
        ratio = Identified(gain.value / reset.value, (gain.value / high, gain.value / low))
    elif Ti is None:
        ratio = Identified(gain.value / reset.value, (gain.ci95[0] / reset.value, gain.ci95[1] / reset.value))
    gross = CONTRADICTS if K and Ti else AGREES  # in doubt only such a difference counts
    K, Ti = abs(K or gain.value), Ti or reset.value
    offset, sure = _distance(K / Ti, ratio)
    apart, sure_apart = _distance(K, gain)
    width = (ratio.ci95[1] - ratio.ci95[0]) / (2.0 * ratio.value)
    coarse = Ti < COARSE * found.interval and (  # not where a slow Ti in the data asked for a slow picture of them
        reset.ci95[0] < LEAST_PER_TI * found.interval and reset.value < SLOWEST / SLOWER * found.interval)
    factor = K / Ti / ratio.value
    shown = f"K {gain.value:.3g}, Ti {reset.value:.3g} s"
    mix_up = _best(K, Ti, settings, gain, ratio, coarse) if abs(offset) > AGREES and sure > SURE else None
    of_spans = mix_up is not None and mix_up.known and abs(offset - log(mix_up.gain / mix_up.reset)) < CLOSE
    if abs(offset) <= AGREES or sure <= (SURE if of_spans or width < WELL_KNOWN else gross):
        if not (found.separate and abs(apart) > GAIN_APART and sure_apart > AGREES):
            return []
        return [noted("settings_gain", _values(found, factor, "warn"), given_K=K, given_Ti=Ti, times=_times(apart),
                      shown=shown)]
    severity = "contradict" if abs(offset) > CONTRADICTS else "warn"
    if mix_up is not None:
        return [Note(mix_up.code, f"{mix_up.words} (the data show {shown})",
                     _values(found, mix_up.gain / mix_up.reset, severity))]
    if coarse:
        return [noted("settings_unchecked:coarse", {"why": "sampling_too_coarse"}, Ti=Ti, interval=found.interval)]
    code = "settings_contradicted" if severity == "contradict" else "settings_disagree"
    message = said("settings_disagree", times=_times(offset), shown=shown, ratio=ratio.value, width=width)
    return [Note(code, message, _values(found, factor, severity))]


def _best(K: float, Ti: float, settings: LoopSettings, gain: Identified, ratio: Identified,
          coarse: bool) -> MixUp | None:
    """The mix-up that explains both K/Ti and K best; the simpler one when two do alike."""
    doubt = max(log(max(gain.ci95[1], gain.value) / gain.value), log(gain.value / max(gain.ci95[0], gain.value / 5)))
    best, best_misfit = None, 1.0
    for m in _mix_ups(K, Ti, settings, gain.value):
        off_ratio, off_gain = log(K / Ti / ratio.value * m.reset / m.gain), log(K / gain.value / m.gain)
        misfit = max(abs(off_ratio) / EXPLAINED, abs(off_gain) / (EXPLAINED + doubt))
        believed = (m.known and not coarse) or abs(log(m.gain / m.reset)) >= LARGE
        if believed and misfit < best_misfit - 0.05:
            best, best_misfit = m, misfit
    return best


def _mix_ups(K: float, Ti: float, settings: LoopSettings, true_gain: float) -> list[MixUp]:
    """Single mistakes first, then one of K together with one of Ti."""
    pv_span, op_span = (abs(high - low) for low, high in (settings.pv_range, settings.op_range))
    of_gain = [MixUp("settings_proportional_band", K * K / 100.0, 1.0,
                     f"K = {K:g} looks like a proportional band of {K:g} % (gain {100 / K:.3g})"), *(
        MixUp("settings_engineering_gain", factor, 1.0,
              f"K = {K:g} looks like a gain in {unit} (per span {K / factor:.3g})", True)
        for factor, unit in (
            (op_span / pv_span, "output units per measurement unit"),
            (op_span, "output units per span of the measurement"), (1.0 / pv_span, "output span per measurement unit"),
            (pv_span / op_span, "measurement units per output unit")) if abs(log(factor)) > AGREES)]
    of_reset = [MixUp(code, 1.0, factor, f"Ti = {Ti:g} {words}") for code, factor, words in (
        ("settings_ti_minutes", 1.0 / 60.0, "s looks 60 times too small: given in minutes?"),
        ("settings_ti_minutes", 60.0, "s looks 60 times too large: seconds taken for minutes?"),
        ("settings_ti_repeats", Ti * Ti, f"looks like repeats per second (Ti {1 / Ti:.3g} s)"),
        ("settings_ti_repeats", Ti * Ti / 60.0, f"looks like repeats per minute (Ti {60 / Ti:.3g} s)"),
        ("settings_form", 1.0 / true_gain, "s looks like that of the parallel form, 1/Ki (Ti = K/Ki)"))]
    both = [MixUp(a.code if abs(log(a.gain)) > abs(log(b.reset)) else b.code, a.gain, b.reset,
                  f"{a.words}, and {b.words}") for a in of_gain for b in of_reset[:4]]
    return [of_reset[0], *of_gain, *of_reset[1:], *both]
