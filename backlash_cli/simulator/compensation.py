"""From one loop's record to advice on a backlash compensator: dead band, process, trials of a range of gains, choice.

Noise and loads are those of the record. Advice to a person: nothing here reaches a control system."""

from dataclasses import replace

import numpy as np

from ..errors import LoopError
from ..estimator.compensator import HYSTERESIS, gain_share
from ..estimator.settings_check import contradicts
from ..kernels import gap_crossings
from ..model.problem import noise_floor
from ..record import FloatArray, Frozen, Note, Record, SampleState
from ..results import LoopReport, Verdict
from ..results.advice import Course
from ..scanning import scan
from ..words import explained, noted
from .controller import Compensator, Controller, Scheme
from .limit_cycle import limit_cycle
from .loop import Trace, trace
from .process import Process
from .process_fit import fit_process
from .scenario import Applied, Scenario, use

CLEARLY = 8.0  # difference of -2 log likelihood: 4 nats, one in fifty by chance
LEAST_MARGIN = 1.4  # gain margin below which a fitted process cannot be the one of a loop that works
SMALLEST_LOAD, LARGEST_LOAD = 1.5, 0.2  # dead bands; span of output
SHARES = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)  # gains shown, in dead bands
MARGIN = 1.25  # the loop must stay quiet at this much more than the recommended gain
MOST_TRAVEL = 1.3  # valve travel that is accepted, relative to the loop without compensator
LEAST_FALL = 0.03  # a smaller fall of IAE is not worth a change in the control system
STEPS_BACK = (1.0, 0.75, 0.5)  # shares of the rule's gain that are tried when the gain itself does not pass
LOAD_STEPS = 12
SPACING = 12.0  # slowest time constants of the loop between load steps
MOST_SAMPLES = 60_000
STILL = 1e-9  # of span: a valve that turns by less stands
DOUBTFUL = "settings_doubtful"  # settings that hardly any controller has
SWING = 0.05  # dead bands: a valve that swings by less and for ever is not worth the name of limit cycle


class Trial(Frozen):
    """One compensator gain and what the simulation gave."""

    gain: float
    iae: float  # mean absolute error
    peak: float  # largest error
    limit_cycle: bool  # goes on oscillating without noise or load
    valve_travel_per_hour: float
    output_travel_per_hour: float
    reversals_per_hour: float  # of the valve


class CompensationStudy(Frozen, eq=False):
    """One loop: what is known of it before a compensator is simulated, then before and after, and the advice."""

    loop: str
    controller: Controller
    process: Process
    d: float  # dead band
    interval: tuple[float, float]  # its ends
    d_source: str  # "scan" or "given"
    density: float  # of the white measurement noise [span^2 s]
    output_noise: float  # standard deviation of the fast motion of the output
    hysteresis: float  # of the error's sign, simulated with every gain
    load: float  # typical load step at the process input
    rule_gain: float  # what the rule allows before any simulation, 0 for none
    reason: str  # why this gain, or why none; the rule's, before any simulation
    warnings: tuple[Note, ...] = ()
    seed: int = 0
    trials: tuple[Trial, ...] = ()  # by gain, the first without compensator
    recommended: float | None = None  # gain, None when refused
    refusals: tuple[Note, ...] = ()  # what speaks against
    before: Course | None = None
    after: Course | None = None  # with the recommended gain

    @property
    def base(self) -> Trial:
        """The loop as it is, without compensator."""
        return self.trials[0]

    def trial(self, gain: float) -> Trial:
        """Return the trial whose gain is closest."""
        return min(self.trials, key=lambda t: abs(t.gain - gain))


def compensate(record: Record, *, process: Process | None = None, dead_band: float | None = None,
               report: LoopReport | None = None) -> CompensationStudy:
    """Return what compensation would do to a loop, simulated; advice to a person, nothing is written anywhere.

    process: given process, else fitted to the record. dead_band: given size [span of output], else from a scan.
    report: the record's scan, made here if not given.
    Raises LoopError when the settings, the dead band or the process cannot be had from the record."""
    report = report or scan(record)
    settings = report.settings
    if settings.K is None or settings.Ti is None:
        raise LoopError(**explained("missing_settings"), where=record.loop)
    if wrong := next((n for n in (*report.reasons, *report.warnings) if contradicts(n) or n.code == DOUBTFUL), None):
        raise LoopError(**explained("wrong_settings", problem=wrong.message), where=record.loop)
    d, interval, d_source = size_of(report, dead_band)
    controller = Controller.of(settings)
    known = replace(record, settings=settings)
    simulated, warnings = model_of(known, controller, d, process)
    if (smaller := contradiction(simulated)) is not None:
        if smaller[1] == 0.0:
            raise LoopError(**explained("no_dead_band", d=d), where=record.loop)
        note = noted("smaller_dead_band", smaller=smaller[1], d=d)
        d, interval = smaller[1], (min(smaller[0], interval[0]), smaller[1])
        simulated, more = model_of(known, controller, d, None)
        warnings = (*warnings, note, *more)
    if d_source == "scan" and report.verdict is Verdict.SUSPECTED:
        warnings = (*warnings, noted("suspected"))
    if simulated.gain * controller.K < 0.0:
        raise LoopError(**explained("wrong_sign", K=controller.K, gain=simulated.gain), where=record.loop)
    density = density_of(record, controller)
    filtered, arrived = (gain * float(np.sqrt(density)) for gain in noise_gains(controller))
    share, why = gain_share(interval[0], derivative=controller.Td > 0.0, output_noise=arrived)
    return study(CompensationStudy(record.loop, controller, simulated, d, interval, d_source, density, arrived,
        HYSTERESIS * filtered, typical_load(record, d), share * interval[0], why, warnings))


def size_of(report: LoopReport, given: float | None) -> tuple[float, tuple[float, float], str]:
    """Return dead band, the ends of its interval and its source. Raises LoopError when the scan found none."""
    if given is not None:
        return given, (given, given), "given"
    if (found := report.claimed) is None:
        reason = report.reasons[0].message if report.reasons else "no half period could be used"
        raise LoopError(**explained("not_seen", verdict=str(report.verdict), reason=reason), where=report.loop)
    return found.d, (min(found.ci95[0], found.d), max(found.ci95[1], found.d)), "scan"


def model_of(record: Record, controller: Controller, d: float, given: Process | None, *, integrating: bool = False
             ) -> tuple[Process, tuple[Note, ...]]:
    """Return the process to simulate and what to know about it. integrating: whether a fitted one may integrate."""
    if given is not None:
        return given, ()
    told = record.settings.source.get("Kp") == "metadata"
    model = fit_process(record, d, record.settings.Kp if told else None, integrating=integrating)
    margin = gain_margin(controller, model)
    if margin >= LEAST_MARGIN:
        return model, ()
    gain = model.gain * margin / LEAST_MARGIN
    return replace(model, gain=gain), (noted("fit_lowered", fitted=model.gain, used=gain),)


def contradiction(model: Process) -> tuple[float, float] | None:
    """Return the low end and the best size of a dead band that fits the record clearly better, None if none does."""
    best, most = max(model.profile, key=lambda p: p[1], default=(0.0, 0.0))
    if not model.profile or most - model.profile[-1][1] <= CLEARLY:
        return None
    return min(d for d, evidence in model.profile if evidence >= most - CLEARLY), best


def gain_margin(controller: Controller, process: Process) -> float:
    """Return by which factor the gain may grow until the loop is unstable, infinite if it never is."""
    omega = np.logspace(-2.0, 4.0, 20_000) / slowest(controller, process)
    loop = controller.response(omega) * process.response(omega)
    down = (loop.imag[:-1] < 0.0) & (loop.imag[1:] >= 0.0) & (loop.real[1:] < 0.0)
    return float(np.min(-1.0 / loop.real[1:][down], initial=np.inf))


def density_of(record: Record, controller: Controller) -> float:
    """Return the density [span^2 s] of a record's measurement noise, in the sense of the effect `measurement_noise`.

    A controller that samples faster than the historian sees less of the noise than the recorded PV tells. OP shows how
    much arrives; but OP is often rounded, which looks like noise. The smaller of the two is right. Third differences
    of OP pass (2 sin(w h/2))^6 of K^2 (1 + w^2 Td^2) / (1 + w^2 Tf^2)^2, 20 times white noise."""
    def deviation(values: FloatArray) -> float:
        on_grid = np.full(len(record) and record.index[-1] - record.index[0] + 1, np.nan)
        on_grid[record.index - record.index[0]] = np.where(record.state == SampleState.GOOD, values, np.nan)
        return noise_floor(on_grid)

    h, tf = record.interval, controller.filter_time
    density = deviation(record.measurement) ** 2 * h
    if record.output is None:
        return density
    omega = np.linspace(0.0, 40.0 / min(tf, 3.0 * h), 40_000)
    spectrum = controller.K**2 * (1.0 + (omega * controller.Td) ** 2) / (1.0 + (omega * tf) ** 2) ** 2
    passed = np.trapezoid(spectrum * (2.0 * np.sin(0.5 * omega * h)) ** 6, omega) / (20.0 * np.pi)
    return float(min(density, deviation(record.output) ** 2 / passed))


def noise_gains(controller: Controller) -> tuple[float, float]:
    """Return standard deviations of filtered measurement and output per square root of the noise density [s^-1/2].

    Behind 1/(1 + s Tf)^2 white noise of density S has the variance S/(4 Tf); P and D part together multiply the
    spectrum by K^2 (1 + w^2 Td^2), which makes K^2 (1 + Td^2/Tf^2) S/(4 Tf) (Parseval). The integral part is slow."""
    tf = controller.filter_time
    filtered = 1.0 / np.sqrt(4.0 * tf)
    return float(filtered), float(abs(controller.K) * filtered * np.hypot(1.0, controller.Td / tf))


def typical_load(record: Record, d: float) -> float:
    """Return the size of a load step that makes OP move as far as in the record [span of output]."""
    smallest = SMALLEST_LOAD * d
    if record.output is None:
        return float(np.clip(2.0 * smallest, None, LARGEST_LOAD))
    low, high = np.nanpercentile(record.output[record.usable], [10.0, 90.0])
    return float(max(min(0.5 * (high - low), LARGEST_LOAD), smallest))


def slowest(controller: Controller, process: Process) -> float:
    """Return the time scale of the loop [s]: integral time, or the process's lags and dead time."""
    return max(controller.Ti, process.dead_time + sum(process.lags))


def run_with(s: CompensationStudy, duration: float, gain: float, *effects: Applied) -> Trace:
    """Simulate the loop, at rest at first, with compensator (9) of this gain, met by these effects."""
    # fine enough for the filter, whose noise would be lost otherwise
    step = max(s.controller.filter_time / 4.0, duration / MOST_SAMPLES)
    compensator = Compensator(gain, Scheme.ERROR, hysteresis=s.hysteresis)
    return trace(Scenario(s.controller, s.process, duration, step, (use("backlash", d=s.d), *effects),
                          compensator=compensator, seed=s.seed))


def study(s: CompensationStudy) -> CompensationStudy:
    """Simulate all gains and choose one. Raises LoopError when the loop is unstable even without compensator."""
    allowed = [back * s.rule_gain for back in STEPS_BACK]
    shares = {0.0, *(share * s.d for share in SHARES)}
    spacing = SPACING * slowest(s.controller, s.process)
    random = np.random.default_rng(s.seed)
    sizes = s.load * random.uniform(0.5, 1.5, LOAD_STEPS) * np.where(np.arange(LOAD_STEPS) % 2, -1.0, 1.0)
    times = spacing * (0.5 + np.arange(LOAD_STEPS) + random.uniform(-0.2, 0.2, LOAD_STEPS))
    loads = (use("load_step", times=times.tolist(), sizes=sizes.tolist()), use("measurement_noise", density=s.density))
    runs = {gain: run_with(s, spacing * (LOAD_STEPS + 0.5), gain, *loads)
            for gain in sorted({*shares, *allowed, *(gain * MARGIN for gain in allowed)})}
    trials = {gain: judge(run, s, gain) for gain, run in runs.items()}
    recommended, reason, refusals = choose(s, trials)
    listed = sorted({*shares, *([recommended, MARGIN * recommended] if recommended else [])})
    before, after = (None if gain is None else glimpse(runs[gain], 4.0 * spacing, 6.0 * spacing)
                     for gain in (0.0, recommended))
    return replace(s, trials=tuple(trials[gain] for gain in listed), recommended=recommended, reason=reason,
                   refusals=refusals, before=before, after=after)


def judge(run: Trace, s: CompensationStudy, gain: float) -> Trial:
    """Return the numbers of one run."""
    hours = run.scenario.duration / 3600.0
    error = np.abs(run.setpoint - run.process_output)
    travel, output_travel = (float(np.sum(np.abs(np.diff(way)))) / hours for way in (run.valve, run.output))
    return Trial(gain, float(np.mean(error)), float(np.max(error)), goes_on_oscillating(s, gain), travel, output_travel,
                 gap_crossings(run.valve, STILL) / hours)


def goes_on_oscillating(s: CompensationStudy, gain: float) -> bool:
    """True when the loop, pushed once and then left alone without noise, still turns its valve over and over."""
    duration = 120.0 * slowest(s.controller, s.process)
    run = run_with(s, duration, gain, use("load_step", times=[0.0], sizes=[2.0 * s.d]))
    valve = run.valve[run.time > 0.7 * duration]
    return bool(gap_crossings(valve, STILL) >= 4 and np.ptp(valve) > SWING * s.d)


def choose(s: CompensationStudy, trials: dict[float, Trial]) -> tuple[float | None, str, tuple[Note, ...]]:
    """Return the recommended gain or None, the reason, and what spoke against (larger) gains."""
    against: list[Note] = []
    if s.process.integrating:
        against.append(noted("integrating"))
    elif trials[0.0].limit_cycle or limit_cycle(s.controller, s.process, s.d) is not None:
        against.append(noted("limit_cycle"))
    if s.rule_gain <= 0.0:
        against.append(Note("noisy_output", s.reason))
    if against:
        return None, against[0].message, tuple(against)
    for back in STEPS_BACK:
        gain = back * s.rule_gain
        notes = objections(trials[0.0], trials[gain], trials[gain * MARGIN])
        if not notes:
            at_more = f"{back:g} of what the rule allows, because at more: {against[-1].message}" if against else ""
            return gain, at_more or s.reason, tuple(against)
        against += notes
    return None, against[-1].message, tuple(against)


def objections(base: Trial, trial: Trial, beyond: Trial) -> list[Note]:
    """Return what speaks against a gain; `beyond` is the trial at 1.25 times that gain."""
    notes = []
    if trial.limit_cycle or beyond.limit_cycle:
        notes.append(noted("compensator_limit_cycle", gain=(trial if trial.limit_cycle else beyond).gain))
    times = trial.valve_travel_per_hour / base.valve_travel_per_hour if base.valve_travel_per_hour else 0.0
    if times > MOST_TRAVEL:
        notes.append(noted("valve_travel", gain=trial.gain, times=times))
    if trial.iae > (1.0 - LEAST_FALL) * base.iae:
        notes.append(noted("no_improvement", gain=trial.gain, change=trial.iae / base.iae - 1.0))
    return notes


def glimpse(run: Trace, first: float, last: float) -> Course:
    """Return the stretch of a run that is drawn, from first to last [s]."""
    inside = np.flatnonzero((run.time >= first) & (run.time < last))
    pick = inside[:: max(1, len(inside) // 1500)]
    shown = (run.time - first, run.setpoint, run.process_output, run.output, run.valve)
    return Course(*(tuple(values[pick].tolist()) for values in shown))
