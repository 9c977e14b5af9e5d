"""What would a backlash compensator do to this loop? The same loads and noise, without it and with a range of gains.

Noise and loads are those of the record. Advice to a person: nothing here reaches a control system.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..record import FloatArray, Note, Record
from ..results.compensation import CompensationStudy, ProcessModel, Trial
from ..results.plan import Course
from .controller import Compensator, Controller, Scheme
from .limit_cycle import limit_cycle
from .loop import Trace, trace
from .process import Process
from .scenario import Applied, Scenario, use

SMALLEST_LOAD, LARGEST_LOAD = 1.5, 0.2  # dead bands; span of output
SHARES = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)  # gains shown, in dead bands
MARGIN = 1.25  # the loop must stay quiet at this much more than the recommended gain
MOST_TRAVEL = 1.3  # valve travel that is accepted, relative to the loop without compensator
LEAST_FALL = 0.03  # a smaller fall of IAE is not worth a change in the control system
STEPS_BACK = (1.0, 0.75, 0.5)  # shares of the rule's gain that are tried when the gain itself does not pass
LOAD_STEPS = 12
SPACING = 12.0  # slowest time constants of the loop between load steps
MOST_SAMPLES = 60_000
SWING = 0.05  # dead bands: a valve that swings by less and for ever is not worth the name of limit cycle


def noise_density(controller: Controller, interval: float, measured: float, arrived: float | None) -> float:
    """Return the density [span^2 s] of the measurement noise, in the sense of the effect `measurement_noise`.

    interval: of the record [s]. measured, arrived: standard deviation of white noise in third differences of PV and OP,
    None without OP. A controller that samples faster than the historian sees less of the noise than the recorded PV
    tells. OP shows how much arrives; but OP is often rounded, which looks like noise. The smaller of the two is right.
    Third differences of OP pass (2 sin(w h/2))^6 of K^2 (1 + w^2 Td^2) / (1 + w^2 Tf^2)^2, 20 times white noise.
    """
    density = measured**2 * interval
    if arrived is None:
        return density
    tf, td = controller.filter_time, controller.Td
    omega = np.linspace(0.0, 40.0 / min(tf, 3.0 * interval), 40_000)
    spectrum = controller.K**2 * (1.0 + (omega * td) ** 2) / (1.0 + (omega * tf) ** 2) ** 2
    passed = np.trapezoid(spectrum * (2.0 * np.sin(0.5 * omega * interval)) ** 6, omega) / (20.0 * np.pi)
    return float(min(density, arrived**2 / passed))


def typical_load(record: Record, d: float) -> float:
    """Return the size of a load step that makes OP move as far as in the record [span of output]."""
    smallest = SMALLEST_LOAD * d
    if record.output is None:
        return float(np.clip(2.0 * smallest, None, LARGEST_LOAD))
    low, high = np.nanpercentile(record.output[record.usable], [10.0, 90.0])
    return float(max(min(0.5 * (high - low), LARGEST_LOAD), smallest))


@dataclass(frozen=True)
class Study:
    """What is known about the loop before the simulation.

    d, interval: dead band and the ends of its interval [span]. density: of the white measurement noise [span^2 s].
    load: size of a typical load step at the process input [span of output]. hysteresis: of the error's sign [span].
    rule_gain: gain that the rule allows, 0 for none, rule_reason: why.
    """

    controller: Controller
    process: Process
    d: float
    interval: tuple[float, float]
    density: float
    load: float
    hysteresis: float
    rule_gain: float
    rule_reason: str
    seed: int = 0

    @property
    def slowest(self) -> float:
        """Time scale of the loop [s]: integral time, or the process's lags and dead time."""
        return max(self.controller.Ti, self.process.dead_time + sum(self.process.lags))

    def scenario(self, duration: float, gain: float, *effects: Applied) -> Scenario:
        """The loop at rest in the middle of its range, with compensator (9) of this gain, met by these effects."""
        # fine enough for the filter, whose noise would be lost otherwise
        step = max(self.controller.filter_time / 4.0, duration / MOST_SAMPLES)
        return Scenario(self.controller, self.process, duration, step, (use("backlash", d=self.d), *effects),
                        compensator=Compensator(gain, Scheme.ERROR, hysteresis=self.hysteresis), seed=self.seed)


def noise_gains(controller: Controller) -> tuple[float, float]:
    """Return standard deviations of filtered measurement and output per square root of the noise density [s^-1/2].

    Behind 1/(1 + s Tf)^2 white noise of density S has the variance S/(4 Tf); P and D part together multiply the
    spectrum by K^2 (1 + w^2 Td^2), which makes K^2 (1 + Td^2/Tf^2) S/(4 Tf) (Parseval). The integral part is slow.
    """
    tf = controller.filter_time
    filtered = 1.0 / np.sqrt(4.0 * tf)
    return float(filtered), float(abs(controller.K) * filtered * np.hypot(1.0, controller.Td / tf))


def study(s: Study, loop: str, d_source: str, model: ProcessModel, warnings: tuple[Note, ...] = ()
          ) -> CompensationStudy:
    """Simulate all gains and choose one. Raises LoopError when the loop is unstable even without compensator."""
    allowed = [back * s.rule_gain for back in STEPS_BACK]
    shares = {0.0, *(share * s.d for share in SHARES)}
    spacing = SPACING * s.slowest
    random = np.random.default_rng(s.seed)
    sizes = s.load * random.uniform(0.5, 1.5, LOAD_STEPS) * np.where(np.arange(LOAD_STEPS) % 2, -1.0, 1.0)
    times = spacing * (0.5 + np.arange(LOAD_STEPS) + random.uniform(-0.2, 0.2, LOAD_STEPS))
    loads = (use("load_step", times=times.tolist(), sizes=sizes.tolist()), use("measurement_noise", density=s.density))
    runs = {gain: trace(s.scenario(spacing * (LOAD_STEPS + 0.5), gain, *loads))
            for gain in sorted({*shares, *allowed, *(gain * MARGIN for gain in allowed)})}
    trials = {gain: judge(run, s, gain) for gain, run in runs.items()}
    recommended, reason, refusals = choose(s, trials)
    listed = sorted({*shares, *([recommended, MARGIN * recommended] if recommended else [])})
    before, after = (None if gain is None else glimpse(runs[gain], 4.0 * spacing, 6.0 * spacing)
                     for gain in (0.0, recommended))
    return CompensationStudy(
        loop=loop,
        settings={"K": s.controller.K, "Ti": s.controller.Ti, "Td": s.controller.Td, "Tf": s.controller.filter_time},
        d=s.d, interval=s.interval, d_source=d_source, process=model,
        output_noise=noise_gains(s.controller)[1] * float(np.sqrt(s.density)),
        hysteresis=s.hysteresis, load=s.load, trials=tuple(trials[gain] for gain in listed), rule_gain=s.rule_gain,
        recommended=recommended, reason=reason, refusals=refusals, warnings=warnings, before=before, after=after,
    )


def judge(run: Trace, s: Study, gain: float) -> Trial:
    """Return the numbers of one run."""
    hours = run.scenario.duration / 3600.0
    error = np.abs(run.setpoint - run.process_output)
    return Trial(gain=gain, iae=float(np.mean(error)), peak=float(np.max(error)),
                 travel=float(np.sum(np.abs(np.diff(run.valve)))) / hours,
                 output_travel=float(np.sum(np.abs(np.diff(run.output)))) / hours,
                 reversals=reversals(run.valve) / hours, limit_cycle=goes_on_oscillating(s, gain))


def reversals(valve: FloatArray) -> float:
    """Return how often a valve position (samples,) turns."""
    moves = np.diff(valve)
    return float(np.count_nonzero(np.diff(np.sign(moves[np.abs(moves) > 1e-9]))))


def goes_on_oscillating(s: Study, gain: float) -> bool:
    """True when the loop, pushed once and then left alone without noise, still turns its valve over and over."""
    duration = 120.0 * s.slowest
    run = trace(s.scenario(duration, gain, use("load_step", times=[0.0], sizes=[2.0 * s.d])))
    valve = run.valve[run.time > 0.7 * duration]
    return bool(reversals(valve) >= 4 and np.ptp(valve) > SWING * s.d)


def choose(s: Study, trials: dict[float, Trial]) -> tuple[float | None, str, tuple[Note, ...]]:
    """Return the recommended gain or None, the reason, and what spoke against (larger) gains."""
    against: list[Note] = []
    if s.process.integrating:
        against.append(Note("integrating", "the process integrates: with integral action and dead band it oscillates "
                            "whatever the gain; a compensator only makes the oscillation smaller"))
    elif trials[0.0].limit_cycle or limit_cycle(s.controller, s.process, s.d) is not None:
        against.append(Note("limit_cycle", "the loop oscillates by itself with this dead band and tuning: repair the "
                            "valve, or retune first (a lower K or a longer Ti)"))
    if s.rule_gain <= 0.0:
        against.append(Note("noisy_output", s.rule_reason))
    if against:
        return None, against[0].message, tuple(against)
    for back in STEPS_BACK:
        gain = back * s.rule_gain
        notes = objections(trials[0.0], trials[gain], trials[gain * MARGIN])
        if not notes:
            reason = s.rule_reason
            if back < 1.0:
                reason = f"{back:g} of what the rule allows, because at more: {against[-1].message}"
            return gain, reason, tuple(against)
        against += notes
    return None, against[-1].message, tuple(against)


def objections(base: Trial, trial: Trial, beyond: Trial) -> list[Note]:
    """Return what speaks against a gain; `beyond` is the trial at 1.25 times that gain."""
    notes = []
    if trial.limit_cycle or beyond.limit_cycle:
        notes.append(Note("compensator_limit_cycle", f"the compensator itself makes the loop oscillate at a gain of "
                          f"{100 * (trial if trial.limit_cycle else beyond).gain:.2f} %"))
    if trial.travel > MOST_TRAVEL * base.travel:
        notes.append(Note("valve_travel", f"at a gain of {100 * trial.gain:.2f} % the valve travels "
                          f"{trial.travel / base.travel:.1f} times as far: it would wear faster"))
    if trial.iae > (1.0 - LEAST_FALL) * base.iae:
        notes.append(Note("no_improvement", f"at a gain of {100 * trial.gain:.2f} % the mean error changes by "
                          f"{100 * (trial.iae / base.iae - 1.0):+.0f} % only"))
    return notes


def glimpse(run: Trace, first: float, last: float) -> Course:
    """Return the stretch of a run that is drawn, from first to last [s]."""
    inside = np.flatnonzero((run.time >= first) & (run.time < last))
    pick = inside[:: max(1, len(inside) // 1500)]
    shown = (run.time - first, run.setpoint, run.process_output, run.output, run.valve)
    return Course(*(tuple(values[pick].tolist()) for values in shown))
