"""A plan in plain words for the people who carry it out, in the units of the loop."""

from collections.abc import Sequence
from functools import partial
from itertools import groupby, pairwise

from ..record import LoopSettings, duration
from ..results.advice import PlanOption
from ..words import WORDS, said
from .twin import Twin

_SAMPLING = ("sampling_too_coarse", "sampling_coarse", "scanned_slowly")
PER_TI = 10.0  # samples in an integral time that are asked for
lasting = partial(duration, digits=2)  # as one says it


def amount(share: float, span: tuple[float, float]) -> str:
    """A move as a number on the loop's own scale, with its share of the span where that is another number."""
    size = abs(span[1] - span[0])
    percent = f"{100.0 * share:.2g} %"
    return percent if size in (1.0, 100.0) else f"{share * size:.3g} ({percent} of span)"


def logging_words(codes: Sequence[str], settings: LoopSettings) -> list[str]:
    """What to mend before any test, a sentence for each code of a note; nothing twice."""
    found = [WORDS["first"][code] for code in codes if code in WORDS["first"]]
    if any(code in _SAMPLING for code in codes):
        every = "at least ten times per integral time" if settings.Ti is None else \
            f"every {lasting(settings.Ti / PER_TI)} or faster"
        found.append(f"sample SP, PV and OP {every}")
    return [f"First: {text}." for text in dict.fromkeys(found)]


def model_words(twin: Twin) -> str:
    """What was simulated, in a sentence."""
    p, c = twin.process, twin.controller
    lags = " and ".join(f"{lag:.3g} s" for lag in p.lags) or "none"
    kind = "integrating, gain per second" if p.integrating else "gain"
    return said("plan:model", kind=kind, gain=p.gain, lags=lags, theta=p.dead_time, source=twin.source, K=c.K, Ti=c.Ti)


def chances(option: PlanOption, target: float) -> str:
    """The chances of an option in a sentence, and of what they are the chances."""
    called, cleared, wrongly = (round((share or 0.0) * option.repeats)
                                for share in (option.power, option.clears, option.false_alarm))
    return said("plan:chances", repeats=option.repeats, target=target, called=called, cleared=cleared, wrongly=wrongly)


def option_words(option: PlanOption, twin: Twin, target: float, limits: tuple[float, float]) -> str:
    """What to do, what will be seen, and how sure it is, in sentences. limits: how far PV and OP may move [spans]."""
    s, chance = twin.record.settings, chances(option, target)
    assert option.duration_s is not None
    if option.kind == "wait":
        if not option.decides:
            return f"Waiting will not tell: not even {lasting(option.duration_s)} more of the same operation. {chance}"
        return f"Wait: {lasting(option.duration_s)} more of the same operation, then scan both together. {chance}"
    assert option.move is not None and option.hold_s is not None
    signal, span = ("SP", s.pv_range) if option.kind == "setpoint_steps" else ("OP", s.op_range)
    where = "In automatic" if signal == "SP" else "In manual"
    levels = (0.0, *option.levels[: len(option.levels) // option.rounds])
    steps = [round(option.move * (b - a), 6) for a, b in pairwise(levels)]
    ways = ", then ".join(f"{', '.join('up' if step > 0 else 'down' for step in alike)} by {amount(size, span)}"
                          for size, alike in groupby(steps, abs))
    ways += f", {option.rounds} times over" * (option.rounds > 1)
    test = said("plan:test", where=where, signal=signal, ways=ways, hold=lasting(option.hold_s),
                whole=lasting(option.duration_s))
    if option.pv_move is None or option.op_move is None:
        return f"{test} {chance}"
    moves = (option.pv_move, s.pv_range, "PV"), (option.op_move, s.op_range, "OP")
    seen = ", ".join(f"{name} by up to {amount(move, span)}" for move, span, name in moves)
    needed = " and ".join(f"--max-{name.lower()}-move {100 * move:.2g}%" for (move, _, name), limit
                          in zip(moves, limits, strict=True) if move > limit)
    beyond = "" if option.within_limits else f" This goes beyond your limits: it needs {needed}."
    return f"{test} It moves {seen}.{beyond}{'' if option.decides else ' This is not enough to be sure.'} {chance}"
