"""The best models of PV without a dead band and with one, beside load steps that neither explains.

Both are searched side by side: every evaluation of the likelihood is one of each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..record import FloatArray
from .fitter import Fitter
from .rows import Rows

# Where a search may begin: lag over that of `Rows`, ln ratio, logit phi. Of 35 tried on 1,350 simulated loops, the best
# of these nine is 4 nats behind the best of all on average.
STARTS = ((0.6, -11.0, -2.0), (0.6, -2.0, -1.0), (1.4, -5.0, -2.0), (1.4, 1.0, -2.0), (1.4, 2.5, 0.0),
          (1.4, 4.0, 0.0), (3.0, 2.5, 0.0), (10.0, -11.0, -2.0), (22.0, -11.0, -2.0))
CALM = (-11.0, -2.0)  # ratio and phi of a load that hardly wanders
CALM_LAGS = (1.0, 2.5)  # lags over that of `Rows` that are tried with it, besides the one found
STEP_PASSES = 3
WORTH = 0.5  # nats: smaller gains are not followed
ROUGHLY = 2.0  # nats: the same while load steps are still to be found
AGAIN = 60.0  # nats that CALM may lie behind what was found if the search is to go on from there
HOPELESS = 40.0  # nats by which a dead band may lie behind before its search is not refined any further
PER_STEP = 7.0  # nats that a load step costs: its row is one of about a thousand
SLOW = -5.0  # ln ratio of a load that hardly wanders or slowly
FAR = 20.0  # nats: of 1,253 neighbours further below, searched for once more, three came out higher, by 4 at most
CHANGES = 3  # how often the best width may change at the end


@dataclass
class Models:
    """Best shape numbers and their log-likelihood (2, 4): without a dead band, and with width number j (from 1).

    passes: shape numbers and width with which load steps were found, one pass after the other.
    """

    best: FloatArray
    j: int
    passes: tuple[tuple[FloatArray, int], ...] = ()

    @property
    def gain(self) -> float:
        """How much better the dead band explains PV [nats]."""
        return float(self.best[1, 3] - self.best[0, 3])

    @property
    def hopeless(self) -> bool:
        """Whether the dead band is so far behind that nothing can be gained by a closer look."""
        return self.gain < -HOPELESS


def first_models(fit: Fitter) -> Models:
    """Return the best models of rows of which nothing is known yet; adds the load steps to `fit`."""
    starts = [np.array([np.log(fit.r.lag * share), ratio, smooth]) for share, ratio, smooth in STARTS]
    return _calmed(fit, _with_load_steps(fit, _begun(fit, starts), _coarse(fit.r)))


def best_of_two(fit: Fitter) -> Models:
    """Return the best models from two beginnings: a load that wanders as PV asks for, and one that does so slowly.

    In the first what are load steps passes for wandering for a while, in the second wandering for load steps; which of
    them ends higher is not known before. A load step has its price.
    """
    one = first_models(fit)
    shock = fit.shock
    if not shock.any():
        return one
    fit.shock = np.zeros_like(shock)
    fit.forget()
    starts = [np.array([np.log(fit.r.lag * share), *rest]) for share, *rest in STARTS if rest[0] <= SLOW]
    x, coarse = fit.r.x, _coarse(fit.r)
    levels = np.array([fit.ll(p, x, coarse) for p in starts])
    k, j = np.unravel_index(int(np.argmax(levels)), levels.shape)
    best = _from(starts[k])
    best[:, 3] = 0.0, 1.0
    two = _with_load_steps(fit, _moved(fit, Models(best, coarse[j]), coarse), coarse, moved=True)
    if not two.hopeless:
        two = _calmed(fit, two)
    if _worth(two, fit.shock) > _worth(one, shock):
        return two
    fit.shock = shock
    fit.forget()
    return one


def _worth(m: Models, shock: FloatArray) -> float:
    return float(m.best[:, 3].max()) - PER_STEP * int(np.count_nonzero(shock))


def further_models(fit: Fitter, before: Models) -> Models:
    """Return the best models of rows that those of `before`, found with their load steps, are a part of."""
    for p, j in before.passes:
        fit.add_load_steps(p, j)
    return _with_load_steps(fit, _moved(fit, before), moved=True)


def final_models(fit: Fitter, m: Models) -> tuple[Models, list[int], FloatArray]:
    """Return the models after a closer look, numbers of widths, and the log-likelihood of each of these at its p."""
    if m.hopeless:
        return m, *widths_and_levels(fit, m)
    m = Models(m.best.copy(), m.j)
    for which in (0, 1):
        fit.ascend(m.best, which, m.j, WORTH)
    for _ in range(CHANGES):
        some, levels = widths_and_levels(fit, m)
        top = some[int(np.argmax(levels))]
        if top == m.j:
            break
        m.j, m.best[1, 3] = top, -np.inf
        fit.ascend(m.best, 1, top, WORTH)
    if _walked(fit, m, dict(zip(some, levels.tolist(), strict=True))):
        some, levels = widths_and_levels(fit, m)
    return m, some, levels


def _walked(fit: Fitter, m: Models, levels: dict[int, float]) -> bool:
    """Go on to the next width as long as the dead band, searched for there, explains PV better; whether it did.

    levels: log-likelihood at each width with the shape numbers of the best. A neighbour FAR below it is not tried.
    """
    begin = m.j
    for side in (-1, 1):
        if levels.get(m.j + side, -np.inf) < m.best[1, 3] - FAR:
            continue
        while 1 <= m.j + side <= len(fit.r.widths):
            beside = m.best.copy()
            beside[1, 3] = -np.inf
            fit.ascend(beside, 1, m.j + side, WORTH)
            if beside[1, 3] < m.best[1, 3] + WORTH:
                break
            m.best, m.j = beside, m.j + side
        if m.j != begin:
            break
    return m.j != begin


def widths_and_levels(fit: Fitter, m: Models) -> tuple[list[int], FloatArray]:
    """Return the numbers of every other width and of those around the best, and the log-likelihood of each."""
    last = len(fit.r.widths)
    some = sorted({*range(1, last + 1, 2), last, *around(fit.r, m.j, (-1, 0, 1))})
    return some, fit.ll(m.best[1, :3], fit.r.x, some)


def around(rows: Rows, j: int, offsets: Sequence[int]) -> list[int]:
    """Return the numbers of the widths that lie so many from width j."""
    return sorted({min(max(j + k, 1), len(rows.widths)) for k in offsets})


def _coarse(rows: Rows) -> list[int]:
    n = len(rows.widths)
    return list(range(min(2, n), n + 1, 3))


def _begun(fit: Fitter, starts: list[FloatArray]) -> Models:
    x, coarse = fit.r.x, _coarse(fit.r)
    middle = coarse[len(coarse) // 2]
    levels = np.array([fit.ll(p, x, [0, middle]) for p in starts])
    none, some = starts[int(np.argmax(levels[:, 0]))], starts[int(np.argmax(levels[:, 1]))]
    best = _from(none)
    fit.ascend(best, 0, middle, ROUGHLY)
    p = some if levels[:, 1].max() > best[1, 3] else best[0, :3]
    j = coarse[int(np.argmax(fit.ll(p, x, coarse)))]
    best[1, :3], best[1, 3] = p, -np.inf
    if j != middle:
        fit.forget()
    fit.ascend(best, 1, j, ROUGHLY)
    return Models(best, j)


def _from(p: FloatArray) -> FloatArray:
    best = np.full((2, 4), -np.inf)
    best[:, :3] = p
    return best


def _with_load_steps(fit: Fitter, m: Models, also: Sequence[int] = (), moved: bool = False) -> Models:
    """The models with load steps added, as many times as there are more; moved: m comes from `_moved`."""
    for _ in range(STEP_PASSES):
        p = m.best[int(m.gain > 0), :3]
        if not fit.add_load_steps(p, m.j):
            break
        m, moved = replace(_moved(fit, m, also), passes=(*m.passes, (p, m.j))), True
    if moved:
        fit.ascend(m.best, int(m.gain <= 0), m.j, ROUGHLY)
    return m


def _moved(fit: Fitter, m: Models, also: Sequence[int] = ()) -> Models:
    """The models after a change of the rows or load steps; the width is one near that before or one of `also`.

    Only the better of the two is searched for: the next load steps are looked for beside it. The other follows it.
    """
    which = int(m.gain > 0)
    near = sorted({*also, *around(fit.r, m.j, (-3, -1, 0, 1, 3))})
    j = near[int(np.argmax(fit.ll(m.best[which, :3], fit.r.x, near)))]
    best = m.best.copy()
    best[:, 3] = -np.inf
    fit.forget()
    fit.ascend(best, which, j, ROUGHLY)
    if best[1 - which, 3] > best[which, 3]:
        fit.ascend(best, 1 - which, j, ROUGHLY)
    return replace(m, best=best, j=j)


def _calmed(fit: Fitter, m: Models) -> Models:
    """Both models once more, the dead band of any width, with a load that hardly wanders."""
    some = [0, *_coarse(fit.r)]
    lags = [m.best[1, 0], *(np.log(fit.r.lag * share) for share in CALM_LAGS)]
    p = np.array([[lag, *CALM] for lag in lags])
    levels = np.array([fit.ll(one, fit.r.x, some) for one in p])
    n, k = int(np.argmax(levels[:, 0])), 1 + int(np.argmax(levels[:, 1:].max(axis=0)))
    w = int(np.argmax(levels[:, k]))
    near = levels[n, 0] > m.best[0, 3] - AGAIN, levels[w, k] > m.best[1, 3] - AGAIN
    if not any(near):
        return m
    calm = Models(np.full((2, 4), -np.inf), some[k])
    calm.best[0, :3], calm.best[1, :3] = p[n], p[w]
    fit.forget()
    for which in (1, 0):
        if near[which]:
            fit.ascend(calm.best, which, calm.j, ROUGHLY)
    fit.forget()
    better = calm.best[:, 3:] > m.best[:, 3:]
    return replace(m, best=np.where(better, calm.best, m.best), j=calm.j if better[1] else m.j)
