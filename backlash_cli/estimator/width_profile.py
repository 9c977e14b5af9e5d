"""How well PV is explained by gaps of each width: where the best one is, how well it is known, and what to report."""

import numpy as np

from ..record import FloatArray
from ..results import Confirmation

NARROWEST = 0.4  # % of span: the narrowest width tried
TURN = 0.9  # of the range of OP: wider gaps were never crossed in both directions
TRACE, DROP = 3.0, 1.92  # nats: of evidence, a trace of a gap; of a likelihood, 95 %


def about(widths: FloatArray, j: int, count: int) -> FloatArray:
    """Up to `count` widths between the neighbours of number j, without that one."""
    fine = np.geomspace(widths[max(j - 1, 0)], widths[min(j + 1, len(widths) - 1)], count + 2)[1:-1]
    return np.asarray(fine[np.abs(fine / widths[j] - 1.0) > 1e-3])


def peak_of(widths: FloatArray, answer: FloatArray) -> float:
    """Width at the top of the parabola in log width through the best one and its neighbours."""
    j = int(answer.argmax())
    if 0 < j < len(widths) - 1 and min(answer[j - 1], answer[j + 1]) > 0.0:
        at = np.log(widths[j - 1 : j + 2])
        a, b, _ = np.polyfit(at - at[1], answer[j - 1 : j + 2], 2)
        if a < 0.0:
            return float(np.exp(np.clip(at[1] - 0.5 * b / a, at[0], at[2])))
    return float(widths[j])


def width_interval(widths: FloatArray, answer: FloatArray, d: float, least: float, doubt: float = 0.0
                   ) -> tuple[float, float]:
    """Ends of the widths whose answer is within DROP and `doubt` nats of the best, at least `least` of d each way."""
    j = int(answer.argmax())
    level = float(answer[j]) - DROP - doubt
    ends = []
    for way in (-1, 1):
        k = j
        while 0 <= k + way < len(widths) and answer[k + way] >= level:
            k += way
        beyond = k + way
        if 0 <= beyond < len(widths):
            above, below = answer[k] - level, level - answer[beyond]
            ends.append(float(widths[k] + (widths[beyond] - widths[k]) * above / max(above + below, 1e-12)))
        else:
            ends.append(float(widths[k]))
    return max(min(ends[0], d * (1.0 - least)), 0.0), max(ends[1], d * (1.0 + least))


def confirmation(d: float, interval: tuple[float, float], reduction: float, limit: float | None,
                 details: dict[str, float | str], widths: FloatArray, answer: FloatArray) -> Confirmation:
    """The Confirmation of what was found in % of span, in spans. details: with `evidence` [nats] and `rows`."""
    profile = tuple((float(w) / 100.0, float(v)) for w, v in zip(widths, answer, strict=True))
    return Confirmation(d / 100.0, (interval[0] / 100.0, interval[1] / 100.0), reduction,
                        2.0 * float(details["evidence"]) - float(np.log(float(details["rows"]))),
                        None if limit is None else limit / 100.0, details, profile)
