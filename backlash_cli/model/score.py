"""When is one model better than another: likelihood and prediction together, less a price for every value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..effects import Effect
from .fit import Fit
from .pipeline import Shape, as_tuple
from .problem import Problem, trust

# a load behind the process forgets within about three lags, so that six lags hold one independent error
LAGS_PER_STRETCH = 6.0
# a slow loop still gets weight enough that a model which does not predict cannot win
LEAST_STRETCHES, MOST_STRETCHES = 30.0, 150.0
# gain in score that an effect must bring, price paid: about what one more value costs twice. Loops with nothing hidden
# gain up to 10 by chance; `python -m tests.benchmarks.explain_benchmark --kind none` counts those that gain more
ENOUGH = 20.0
# more than any likelihood
WRONG_WAY = 1e7


def jumpy(effect: Effect) -> bool:
    """True when the error of an effect has narrow valleys, so that slopes alone do not find the lowest."""
    return effect.fitting.search == "jumpy"


@dataclass(frozen=True)
class Judge:
    """Scores fits of the loop `problem`, whose process has about the time constant `lag` [s].

    The deviance knows how well each sample follows from those before it. A random load that may wander without
    limit explains a drift or a step as well as the real cause does; it does not predict PV from OP. The error of
    that prediction, over as many stretches as are independent, decides where the deviance cannot. It tells nothing
    where OP only answers to the load, so that it counts for less the more it does (see `problem`).
    """

    problem: Problem
    lag: float

    def price(self, shape: Shape) -> float:
        """Return what the values of all effects cost, in units of deviance (Schwarz 1978: ln n for each).

        A value picked from all places of the record costs twice, and narrow valleys, of which one is always deep by
        chance, cost two values more, as does an effect that is seldom.
        """
        total = 0.0
        for part in shape.parts:
            fitting = part.effect.fitting
            total += 2.0 if jumpy(part.effect) or fitting.seldom else 0.0
            for q in part.effect.parameters:
                numbers = as_tuple(part.values.get(q.name, ()))
                if not q.choices and (q.many or not q.nuisance) and np.all(np.isfinite(numbers)):
                    total += len(numbers) * (2.0 if q.name in fitting.dear else 1.0)
        return total * float(np.log(np.count_nonzero(self.problem.used)))

    def score(self, fitted: Fit) -> float:
        """Return deviance plus price plus prediction error: smaller is better."""
        problem = self.problem
        stretches = problem.duration / (LAGS_PER_STRETCH * max(self.lag, problem.interval))
        stretches = min(max(stretches, LEAST_STRETCHES), MOST_STRETCHES) * trust(problem.driven)
        # a loop under control has a process of the sign of its controller; the mirror image is the controller itself
        wrong = WRONG_WAY if (problem.settings.K or problem.settings.Kp or 0.0) * fitted.gain < 0.0 else 0.0
        return wrong + fitted.deviance + self.price(fitted.shape) + stretches * 2.0 * float(np.log(fitted.rmse))

    def best(self, fits: Sequence[Fit]) -> Fit:
        """Return the fit of the smallest score."""
        return min(fits, key=self.score)
