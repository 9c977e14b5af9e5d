"""The values that were solved for, in the effects' own units: sizes, slopes, gains, amplitude and phase of a swing."""

from __future__ import annotations

import numpy as np

from .fit import Fit
from .pipeline import as_tuple
from .problem import Problem


def linear_values(problem: Problem, fitted: Fit) -> list[dict[str, float | tuple[float, ...]]]:
    """Return for each part all its values, those that were solved for included, in the effect's own units."""
    out = []
    column = 2 + len(problem.holes) + 1
    for part in fitted.shape.parts:
        values = dict(part.values)
        if part.is_linear:
            for name in part.effect.fitting.linear:
                several = isinstance(values.get(name), tuple)
                count = len(as_tuple(values[name])) if several else 1
                found = []
                for _ in range(count):
                    if part.effect.fitting.phase:
                        inphase, quadrature = fitted.coefficients[column : column + 2] / fitted.gain
                        found.append(float(np.hypot(inphase, quadrature)))
                        values[part.effect.fitting.phase] = float(np.arctan2(quadrature, inphase))
                        column += 2
                    else:
                        found.append(float(fitted.coefficients[column] / fitted.gain))
                        column += 1
                values[name] = tuple(found) if several else found[0]
        out.append(values)
    return out
