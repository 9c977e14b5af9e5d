"""From one loop's record to advice on a backlash compensator: dead band, process, simulation, gain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .errors import LoopError
from .estimator.compensator import HYSTERESIS, gain_share
from .model.problem import noise_floor
from .record import FloatArray, Note, Record, SampleState
from .results import LoopReport, Verdict
from .results.compensation import CompensationStudy, ProcessModel
from .scanning import scan
from .simulator.compensation import Study, noise_density, noise_gains, study, typical_load
from .simulator.controller import Controller
from .simulator.process import Process
from .simulator.process_fit import fit_process

CLEARLY = 8.0  # difference of -2 log likelihood: 4 nats, one in fifty by chance
LEAST_MARGIN = 1.4  # gain margin below which a fitted process cannot be the one of a loop that works


def compensate(record: Record, *, process: Process | None = None, dead_band: float | None = None,
               report: LoopReport | None = None, seed: int = 0) -> CompensationStudy:
    """Return what compensation would do to a loop, simulated; advice to a person, nothing is written anywhere.

    process: given process, else fitted to the record. dead_band: given size [span of output], else from a scan.
    report: the record's scan, made here if not given.
    Raises LoopError when the settings, the dead band or the process cannot be had from the record.
    """
    report = report or scan(record)
    settings = report.settings
    if settings.K is None or settings.Ti is None:
        raise LoopError("K and Ti are not known", where=record.loop, remedy="give them in loops.toml",
                        code="missing_settings")
    d, interval, d_source = size_of(report, dead_band)
    controller = Controller(settings.K, settings.Ti, settings.Td, (settings.Tf or None) if settings.Td else settings.Tf)
    known = replace(record, settings=settings)
    model, warnings = model_of(known, controller, d, process)
    if (smaller := contradiction(model)) is not None:
        if smaller[1] == 0.0:
            raise LoopError(f"the record fits better without any dead band than with {100 * d:.2f} %",
                            where=record.loop, code="no_dead_band",
                            remedy="take a later record, or test the valve: there is nothing to compensate here")
        note = Note("smaller_dead_band", f"the record fits a dead band of {100 * smaller[1]:.2f} % clearly better than "
                    f"{100 * d:.2f} %; the smaller one is used")
        d, interval = smaller[1], (min(smaller[0], interval[0]), smaller[1])
        model, more = model_of(known, controller, d, None)
        warnings = (*warnings, note, *more)
    if d_source == "scan" and report.verdict is Verdict.SUSPECTED:
        warnings = (*warnings, Note("suspected", "the scan only suspects backlash; confirm it by a valve test first"))
    simulated = process or Process.of(model)
    if simulated.gain * controller.K < 0.0:
        raise LoopError(f"K = {controller.K:g} and the process gain {simulated.gain:g} make positive feedback",
                        where=record.loop, remedy="give both the same sign", code="wrong_sign")
    density = density_of(record, controller)
    filtered, arrived = (gain * float(np.sqrt(density)) for gain in noise_gains(controller))
    share, why = gain_share(interval[0], derivative=controller.Td > 0.0, output_noise=arrived)
    known_loop = Study(controller, simulated, d, interval, density, typical_load(record, d), HYSTERESIS * filtered,
                       share * interval[0], why, seed)
    return study(known_loop, record.loop, d_source, model, warnings)


def density_of(record: Record, controller: Controller) -> float:
    """Return the density [span^2 s] of a record's measurement noise."""
    def deviation(values: FloatArray) -> float:
        on_grid = np.full(len(record) and record.index[-1] - record.index[0] + 1, np.nan)
        on_grid[record.index - record.index[0]] = np.where(record.state == SampleState.GOOD, values, np.nan)
        return noise_floor(on_grid)

    arrived = None if record.output is None else deviation(record.output)
    return noise_density(controller, record.interval, deviation(record.measurement), arrived)


def size_of(report: LoopReport, given: float | None) -> tuple[float, tuple[float, float], str]:
    """Return dead band, the ends of its interval and its source. Raises LoopError when the scan found none."""
    if given is not None:
        return given, (given, given), "given"
    found = report.confirmation or report.cluster
    if found is None or found.d <= 0.0 or report.verdict not in (Verdict.BACKLASH, Verdict.SUSPECTED):
        reason = report.reasons[0].message if report.reasons else "no half period could be used"
        raise LoopError(f"the scan does not see backlash ({report.verdict}: {reason})", where=report.loop,
                        remedy="give one from a valve test with --dead-band 0.03 (3 % of the output span)",
                        code="no_dead_band")
    return found.d, (min(found.ci95[0], found.d), max(found.ci95[1], found.d)), "scan"


def model_of(record: Record, controller: Controller, d: float, given: Process | None, *, integrating: bool = False
             ) -> tuple[ProcessModel, tuple[Note, ...]]:
    """Return the process to simulate and what to know about it. integrating: whether a fitted one may integrate."""
    if given is not None:
        return ProcessModel(given.static_gain or given.gain, given.lags, given.dead_time, given.integrating), ()
    told = record.settings.source.get("Kp") == "metadata"
    model = fit_process(record, d, record.settings.Kp if told else None, integrating=integrating)
    margin = gain_margin(controller, Process.of(model))
    if margin >= LEAST_MARGIN:
        return model, ()
    gain = model.gain * margin / LEAST_MARGIN
    note = Note("fit_lowered", f"with the fitted process gain {model.gain:.3g} the loop would be (almost) unstable, "
                f"which it is not; {gain:.3g} is used. --process gives a better one")
    return replace(model, gain=gain), (note,)


def contradiction(model: ProcessModel) -> tuple[float, float] | None:
    """Return the low end and the best size of a dead band that fits the record clearly better, None if none does."""
    if not model.profile:
        return None
    best = max(model.profile, key=lambda p: p[1])
    if best[1] - model.profile[-1][1] <= CLEARLY:
        return None
    return min(d for d, evidence in model.profile if evidence >= best[1] - CLEARLY), best[0]


def gain_margin(controller: Controller, process: Process) -> float:
    """Return by which factor the gain may grow until the loop is unstable, infinite if it never is."""
    slowest = max(controller.Ti, process.dead_time + sum(process.lags))
    omega = np.logspace(-2.0, 4.0, 20_000) / slowest
    loop = controller.response(omega) * process.response(omega)
    down = np.flatnonzero((loop.imag[:-1] < 0.0) & (loop.imag[1:] >= 0.0) & (loop.real[1:] < 0.0))
    return float(1.0 / np.max(-loop.real[down + 1])) if len(down) else float("inf")
