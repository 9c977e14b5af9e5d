"""Recommended compensator gain: cautious, because a gain above the true dead band makes the loop oscillate."""

from __future__ import annotations

from ..results import Cluster, Compensator, Confirmation

SHARE_PI = 0.8
SHARE_NOISY = 0.5
SCHEME_ERROR = "error-sign (9)"
SCHEME_OUTPUT = "filtered-output (8)"


def recommend(cluster: Cluster | None, confirmation: Confirmation | None, *, derivative: bool,
              output_noise: float) -> Compensator | None:
    """Return the gain delta [span of output] for scheme (9), None where compensation would do harm.

    derivative: the controller uses Td. output_noise: standard deviation of the fast motion of the output [span].
    PI: 0.8 of the lower end of the interval of d. With derivative action or noise above d/10: 0.5 of it.
    Noise above d/5: none, the valve would move at every sign change of the noise.
    """
    best = confirmation or cluster
    if best is None:
        return None
    low = min(best.ci95[0], best.d)
    if output_noise > best.d / 5.0 or low <= 0:
        return None
    if derivative or output_noise > best.d / 10.0:
        return Compensator(SHARE_NOISY * low, SCHEME_ERROR, "half of the lower end of the interval: derivative action "
                           "or noise on the output make a larger gain wear the valve")
    return Compensator(SHARE_PI * low, SCHEME_ERROR,
                       "0.8 of the lower end of the interval, so that the gain stays below the true dead band")
