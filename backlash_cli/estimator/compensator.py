"""Recommended compensator gain: cautious, because a gain above the true dead band makes the loop oscillate.

One rule for `scan` and `compensate`. With scheme (9) the output jumps by the gain whenever the error changes sign,
and close to the setpoint noise alone changes it all the time. The valve stays still in its gap as long as the jump
and the noise on the output together are smaller than the gap: gain + 5 sigma < d (5 sigma: peak to peak of noise over
a few hundred samples). `python -m tests.benchmarks.compensation_benchmark` prints what the rule reaches."""

from ..results import Cluster, Compensator, Confirmation
from ..words import said

SHARE_PI = 0.8  # below 1 because valve travel, not the error, grows first when the gain comes near the dead band
SHARE_NOISY = 0.5  # with derivative action, which carries more noise to the output than a scan can see
NOISE_SPREAD = 5.0  # peak to peak of the fast motion of the output, in standard deviations
SMALLEST_SHARE = 0.2  # a gain below this fifth of the dead band changes nothing that anyone would notice
HYSTERESIS = 1.0  # standard deviations of the filtered measurement before the sign of the error counts as changed


def gain_share(d: float, *, derivative: bool, output_noise: float) -> tuple[float, str]:
    """Return the share of the dead band d [span of output] that a compensator may use (0: none), and why.

    derivative: the controller uses Td. output_noise: standard deviation of the fast motion of the output [span].

    >>> gain_share(0.05, derivative=False, output_noise=0.0)[0]
    0.8
    >>> gain_share(0.05, derivative=False, output_noise=0.005)[0]
    0.5
    >>> gain_share(0.05, derivative=False, output_noise=0.01)
    (0.0, 'noise on the output is 20 % of the dead band: every change of its sign would move the valve')"""
    if d <= 0.0:
        return 0.0, said("gain:zero")
    noise = output_noise / d
    free = 1.0 - NOISE_SPREAD * noise
    if free < SMALLEST_SHARE:
        return 0.0, said("gain:none", noise=noise)
    cap, why = (SHARE_NOISY, "gain:derivative") if derivative else (SHARE_PI, "gain:usual")
    return (free, said("gain:noisy", noise=noise)) if free < cap else (cap, said(why))


def recommend(cluster: Cluster | None, confirmation: Confirmation | None, *, derivative: bool,
              output_noise: float, oscillating: bool = False) -> Compensator | None:
    """Return the gain delta [span of output] for scheme (9), `gain_share` of the lower end of the interval of d, None
    where compensation would do harm. oscillating: most of the time, by integrator, tuning or load: no gain heals it."""
    best = confirmation or cluster
    if best is None or oscillating:
        return None
    low = min(best.ci95[0], best.d)
    share, why = gain_share(low, derivative=derivative, output_noise=output_noise)
    if share == 0.0:
        return None
    return Compensator(share * low, "error-sign (9)", f"{share:.2g} of the lower end of the interval: {why}")
