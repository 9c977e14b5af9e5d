"""Why an effect that was tried was not taken, and what to think of a gap in a valve that was found but is small."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..record import Note
from ..results import Candidate, FittedEffect, FittedParameter, gap_size
from .locate import turning_points
from .problem import Problem

# a gap below this part of the span is what a good valve has: the usual rule is 1 % of travel with a positioner
HEALTHY = 0.01
# OP must take this many samples to cross a gap, and PV must move by this many times its noise, to call it well seen
FEW_SAMPLES, TIMES_NOISE = 5.0, 2.0


def usual_move(problem: Problem) -> float:
    """Return by how much OP usually moves from one sample to the next while it moves [span]."""
    moves = np.abs(np.diff(problem.output))
    moves = moves[moves > 1e-9]
    return float(np.median(moves)) if moves.size else 0.0


def marked(problem: Problem, gain: float, effects: Iterable[FittedEffect]) -> tuple[FittedEffect, ...]:
    """Return accepted effects, each gap with notes where it is small; gain: of the process [PV span / OP span]."""
    return tuple(replace(e, notes=tuple(_small(problem, gain, gap_size(e)))) for e in effects)


def _small(problem: Problem, gain: float, d: float | None) -> list[Note]:
    if d is None:
        return []
    out = []
    if d < HEALTHY:
        message = f"{100 * d:.2g} % of span is less than the {100 * HEALTHY:.0f} % that a good valve may have"
        out.append(Note("small_gap", message, {"size": d, "limit": HEALTHY}))
    move = usual_move(problem)
    if move > 0.0 and d < FEW_SAMPLES * move:
        message = f"OP crosses the gap within {d / move:.1f} samples: recorded too coarsely to be sure of it"
        out.append(Note("coarse_samples", message, {"samples": d / move}))
    if abs(gain) * d < TIMES_NOISE * problem.floor:
        times = abs(gain) * d / problem.floor
        message = f"the gap moves PV by only {times:.1f} times its noise"
        out.append(Note("small_against_noise", message, {"times": times}))
    return out


def with_reasons(
    problem: Problem,
    gain: float,
    candidates: Sequence[Candidate],
    accepted: Sequence[str],
    alike: Sequence[tuple[str, str]],
    siblings: Mapping[str, Sequence[str]],
    reason: Note | None,
    enough: float,
) -> tuple[Candidate, ...]:
    """Return the candidates, each that was not accepted with the reason.

    gain: of the process. alike: (accepted, other) that the record cannot tell apart. siblings: look-alikes by name.
    reason: why nothing can be told about the loop at all. enough: evidence that an effect must bring.
    """
    move = usual_move(problem)
    turns = sum(map(len, turning_points(problem.output, max(move, 0.02 * float(np.ptp(problem.output))))))
    finest = max(problem.floor / max(abs(gain), 1e-9), move)

    def why(c: Candidate) -> Note | None:
        if c.effect in accepted:
            return None
        d, by = gap_size(c), " and ".join(name.replace("_", " ") for name in accepted)
        if taken := [a for a, other in alike if other == c.effect]:
            return Note("look_alike", f"{taken[0].replace('_', ' ')} was taken; this record cannot tell the two apart")
        if taken := [a for a in accepted if c.effect in siblings.get(a, ())]:
            return Note("look_alike_better", f"{taken[0].replace('_', ' ')}, which looks much like it, fits better")
        if reason is not None:
            return reason
        if d is not None and turns < 2:
            return Note("op_never_turns", "OP never turns back, so that a gap cannot show")
        if _does_nothing(c):
            return Note("fits_nothing", "it fits best where it does nothing")
        if d is not None and d < finest:
            message = f"the gap that fits best is {100 * d:.2g} % of span, less than the recording shows"
            return Note("below_resolution", f"{message} ({100 * finest:.2g} %)", {"size": d, "resolution": finest})
        if (c.evidence or 0.0) >= enough and accepted:
            return Note("other_explains", f"{by} explain{'s' * (len(accepted) == 1)} the same error better")
        if (c.evidence or 0.0) < enough and c.error_reduction > LOWER:
            return Note("little_evidence", "unseen samples are predicted better, but no more than chance may give")
        return Note("no_better_prediction", "unseen samples are predicted no better with it")

    return tuple(replace(c, why=why(c)) for c in candidates)


# share of the squared hold-out error that goes where the error is 1.08 times larger without the effect
LOWER = 1.0 - 1.0 / 1.08**2


def _does_nothing(c: Candidate) -> bool:
    """True where the sizes of an effect went to nothing: zero, or a limit at infinity."""
    sizes = [p for p in c.parameters.values() if not p.nuisance and p.unit not in ("s", "0 or 1")]
    return bool(sizes) and all(_nothing(p) for p in sizes)


def _nothing(p: FittedParameter) -> bool:
    values = np.atleast_1d(np.asarray(p.value, dtype=np.float64))
    return bool(np.all(np.isinf(values) | (np.abs(values) < 1e-5)))
