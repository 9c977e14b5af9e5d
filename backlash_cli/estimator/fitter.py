"""The likelihood of one loop's rows, and the searches for the numbers that shape it and for load steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..record import FloatArray, IntArray
from . import likelihood, search, step_search
from . import whitening as core
from .rows import Rows, counted

STEP_LIMIT = 4.0  # a load step must stand out this much under every d: one false one in 16,000 rows
ASIDE = 4  # under the best width, and under those so many widths beside it


class Fitter:
    """The likelihood of one loop's rows for given shape numbers p = (ln lag, ln ratio, logit phi).

    shock (rows,): variance of the load steps found so far, in units of that of the measurement noise.
    """

    def __init__(self, rows: Rows, shock: FloatArray | None = None) -> None:
        self.r = rows
        self._line = np.ascontiguousarray(rows.line)  # for another order all would be compiled once more
        n = len(rows.y)
        self.shock = np.zeros(n) if shock is None else shock.copy()
        self.counted = counted(rows.first)
        jumps = np.abs(np.diff(rows.y))[~rows.first[1:]]
        self.ridge = max(float(np.median(jumps)) / 0.6745 / np.sqrt(2.0), 1e-6) ** 2
        self.G, self.S = np.empty((n, 4)), np.empty(n)
        self.R = np.empty((2, n), dtype=np.float32)
        self._room = (np.zeros((core.CHUNK, core.LANES), dtype=np.float32),
                      np.empty((core.LANES, n), dtype=np.float32))
        self._slopes, self._taken = np.empty((2, 3, n + len(core.LAGS)), dtype=np.float32), np.zeros((2, 4))
        self.forget()

    def pair(self, p: FloatArray, xa: FloatArray, xb: FloatArray | None = None) -> Any:
        """Log-likelihoods (2,), noise variances (2,) and responses (2, lags) of two valve positions (rows,).

        Residuals are left in `R`, gains and variances of the filter in `G` and `S`.
        """
        found = likelihood.pair(p, xa, xa if xb is None else xb, xb is not None, self.r.y, self._line, self.r.first,
                               self.counted, self.ridge, self.shock, self.G, self.S, *self._room, self.R)
        return found[:3]

    def ll(self, p: FloatArray, x: FloatArray, which: Sequence[int] | IntArray | None = None) -> FloatArray:
        """Log-likelihood of each valve position in x (positions, rows), or of those in `which`."""
        chosen = np.arange(len(x)) if which is None else np.asarray(which, dtype=np.int64)
        found: FloatArray = likelihood.several(p, x, chosen, self.r.y, self._line, self.r.first, self.counted,
                                               self.ridge, self.shock, self.G[:0], self.S, *self._room, self.R)
        return found

    def ascend(self, found: FloatArray, which: int, j: int, worth: float) -> None:
        """Raise the likelihood of OP (which = 0) or of width j (1) over p until a step gains less than `worth` [nats].

        found (2, 4): best p and log-likelihood of OP and of width j, both brought up to date.
        """
        search.ascend(found, which, worth, self._slopes, self._taken, self.r.x[0], self.r.x[j], self.r.y, self._line,
                      self.r.first, self.counted, self.ridge, self.shock, self.G[:0], self.S, *self._room, self.R)

    def forget(self) -> None:
        """Let the next search begin from nothing: it is elsewhere."""
        self._taken[:, 3] = np.inf

    def add_load_steps(self, p: FloatArray, j: int) -> bool:
        """Allow for load steps that stand out without a dead band and with each width around j; False for none."""
        some = np.array(sorted({0, max(j - ASIDE, 1), j, min(j + ASIDE, len(self.r.widths))}))
        found: bool = step_search.add_load_steps(
            p, self.r.x, some, STEP_LIMIT, self.r.y, self._line, self.r.first, self.counted, self.ridge, self.shock,
            self.G, self.S, *self._room, self.R)
        return found
