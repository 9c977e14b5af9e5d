"""Clues for start values: where in time a load step, or at which period a swing, explains most of what is missed.

Both ask for the gain in likelihood of one more column. For a step at every possible sample this takes one backward
pass per column of the model, because <whitened step at k, z> = sum over j >= k of (transposed z)_j.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..effects.fitting import Values
from ..record import FloatArray
from .noise import Whitener
from .pipeline import Shape, moved_output, regressors
from .problem import Problem
from .response import delayed_lag, lag_transposed

# a column of which less than this share is new to the model cannot carry an effect of its own
LEAST_NEW = 0.05
# load steps may follow each other after this share of the record, however slow the process
MOST_APART = 0.02


class Clue:
    """What is known about the loop when start values are proposed (see effects.fitting.Clues)."""

    def __init__(
        self, problem: Problem, shape: Shape, white: Whitener, known: Mapping[str, Values],
        entering: FloatArray | None = None,
    ) -> None:
        self._problem, self._shape, self._white = problem, shape, white
        self.output = moved_output(problem, shape.parts) if entering is None else entering
        self.measurement: FloatArray = problem.measurement
        self.used: NDArray[np.bool_] = problem.used
        self.interval = problem.interval
        self.lag = shape.lag
        self.duration = problem.duration
        # pushes that come sooner than the loop can answer are one event, and its shape that of the process
        usual = min(max(shape.lag, problem.settings.Ti or 0.0), MOST_APART * problem.duration)
        self.apart = max(int(usual / problem.interval), 2)
        self.known = known

    def _space(self) -> tuple[FloatArray, FloatArray]:
        """Return an orthonormal basis of the model's whitened columns (samples, columns) and the whitened rest."""
        Z = self._white.columns(np.column_stack([regressors(self._problem, self._shape), self._problem.measurement]))
        Q, _ = np.linalg.qr(Z[:, :-1])
        rest = Z[:, -1] - Q @ (Q.T @ Z[:, -1])
        return Q, rest

    def step_times(self, count: int) -> list[tuple[float, ...]]:
        """Return sets of 1..count times at which a step load explains most of what the model misses."""
        Q, rest = self._space()
        own = np.cumsum(self._step(1) ** 2)[::-1]
        left = own - sum(self._from_there_on(q) ** 2 for q in np.ascontiguousarray(Q.T))
        missed = self._from_there_on(rest)

        def best(others: list[int]) -> int:
            """The sample at which one more step beside `others` gains most: what is new of each, and what it meets."""
            new, meets = left, missed
            if others:
                steps = np.column_stack([self._step(k) for k in others])
                extra, _ = np.linalg.qr(steps - Q @ (Q.T @ steps))
                reach = np.column_stack([self._from_there_on(e) for e in np.ascontiguousarray(extra.T)])
                new, meets = left - np.sum(reach**2, axis=1), missed - reach @ (extra.T @ rest)
            gain = np.where(new > LEAST_NEW * own, meets**2 / np.maximum(new, 1e-300), 0.0)
            gain[: max(2, int(self.lag / self.interval))] = 0.0
            gain[-2:] = 0.0
            for k in others:
                gain[max(0, k - self.apart) : k + self.apart + 1] = 0.0
            return int(np.argmax(gain))

        chosen: list[int] = []
        sets = []
        for _ in range(count):
            chosen.append(best(chosen))
            for _sweep in range(2 if len(chosen) > 1 else 0):
                before = list(chosen)
                for i in range(len(chosen)):
                    chosen[i] = best(chosen[:i] + chosen[i + 1 :])
                if chosen == before:
                    break
            sets.append(tuple(self.interval * k for k in sorted(chosen)))
        return sets

    def _step(self, k: int) -> FloatArray:
        u = np.zeros(self._problem.samples)
        u[k:] = 1.0
        return self._white.one(delayed_lag(u, self.interval, self.lag, 0.0))

    def _from_there_on(self, z: FloatArray) -> FloatArray:
        """Return <whitened step at k, z> for every k, (samples,)."""
        return np.cumsum(lag_transposed(self._white.transposed(z), self.interval, self.lag)[::-1])[::-1]

    def periods(self, count: int) -> list[float]:
        """Return the periods of the `count` strongest lines in what the model misses; three swings at least."""
        _, rest = self._space()
        size = 4 * self._problem.samples
        power = np.abs(np.fft.rfft(rest, size)) ** 2
        power[: 3 * 4] = power[-size // 8 :] = 0.0
        out: list[float] = []
        while len(out) < count and np.max(power) > 0.0:
            k = int(np.argmax(power))
            out.append(size * self.interval / k)
            power[max(0, k - 8) : k + 9] = 0.0
        return out
