"""A comparison and an explanation made by hand from a simulated valve with play, for tests of texts and pages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from backlash_cli.kernels import play
from backlash_cli.record import LoopSettings, Note
from backlash_cli.results import (
    Candidate,
    Comparison,
    Explanation,
    Fitness,
    FittedEffect,
    FittedParameter,
    Model,
    ModelEffect,
    Region,
    Series,
    Step,
)

START, SAMPLES = 1773734400.0, 3000
SETTINGS = LoopSettings(pv_range=(0.0, 900.0), op_range=(0.0, 100.0))


def lag(u: np.ndarray, tau: float = 20.0) -> np.ndarray:
    out, x, a = np.empty_like(u), u[0], float(np.exp(-1.0 / tau))
    for k, value in enumerate(u):
        out[k] = x
        x = a * x + (1.0 - a) * value
    return out


def signals() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """OP, measured PV, PV of the plain model, PV of the model with play."""
    random = np.random.default_rng(3)
    t = np.arange(float(SAMPLES))
    output = 0.45 + 0.08 * np.sin(t / 90.0) + 0.04 * np.sin(t / 31.0)
    stem = play(output, 0.06, float(output[0]))
    true = 1.2 * lag(stem)
    return output, true + 0.004 * random.standard_normal(SAMPLES), 1.1 * lag(output) + 0.045, true


def series(predicted: np.ndarray | None = None) -> Series:
    output, measured, _, true = signals()
    used = np.ones(SAMPLES, dtype=bool)
    used[1000:1100] = False
    return Series(START + np.arange(float(SAMPLES)), np.full(SAMPLES, 0.54), output, np.where(used, measured, np.nan),
                  true if predicted is None else predicted, used)


def regions() -> tuple[Region, ...]:
    turns = tuple((START + 280.0 * k, START + 280.0 * k + 60.0) for k in range(10))
    return (
        Region("after output reversals", 0.021, 0.62, 900, "reversal", 0.3,
               "After the output turned: 62 % of the squared error in 30 % of the samples.", turns),
        Region("OP below 40 %", 0.012, 0.2, 700, "output level", 0.25,
               "With the output below 40 %: 20 % of the error in 25 % of the samples.", ((START, START + 50.0),)),
        Region("slow swings", 0.01, 0.1, 2900, "frequency", None,
               "In changes slower than 300 s: 10 % of the squared error."),
    )


def backlash() -> FittedEffect:
    return FittedEffect(
        "backlash",
        {"d": FittedParameter(0.0602, "span", (0.0594, 0.0611), "dead band"),
         "position": FittedParameter(0.2, "half gap", None, nuisance=True)},
        sentence="Play in the valve linkage.", meaning="The linkage has {d} of play.", stage="valve",
    )


BASELINE = Fitness(0.0312, 0.032, {"Kp": FittedParameter(1.1, "PV span/OP span", (1.0, 1.2)),
                                   "tau": FittedParameter(22.0, "s", (19.0, 25.0))})
MODEL = Model("FIC101", 1.2, 20.0, 0.0, 0.0, (ModelEffect("backlash", {"d": 0.0602, "position": 0.2}),),
              START, START + SAMPLES - 1.0, 1.0, (0.0, 900.0), (0.0, 100.0), 0.008)


def explanation(loop: str = "FIC101") -> Explanation:
    _, _, plain, true = signals()
    found = backlash()
    sizes = FittedParameter((0.02, -0.01), "OP span", ((0.015, 0.025), (-0.02, 0.0)))
    steps = FittedEffect("load_step", {"times": FittedParameter((600.0, 1800.0), "s"), "sizes": sizes},
                         meaning="At {times} something pushed by {sizes}.", stage="load")
    return Explanation(
        loop, BASELINE, 0.0075,
        candidates=(
            Candidate("backlash", found.parameters, stage="valve", rmse_holdout=0.0081, error_reduction=0.936,
                      evidence=512.0, verdict="accepted"),
            Candidate("rate_limit", {"rate": FittedParameter(float("inf"), "1/s")}, rmse_holdout=0.03,
                      error_reduction=0.12, evidence=4.0),
            Candidate("measured_disturbance", {"gain": FittedParameter(0.001, "OP span per column unit")}, "DV1",
                      rmse_holdout=0.0319, error_reduction=0.01),
        ),
        steps=(Step(None, 0.032, 0.031, plain), Step("backlash", 0.0081, 0.008, true),
               Step("load_step", 0.008, 0.0079, true)),
        effects=(found, steps), missing_effect="backlash", where=regions(), where_before=regions(), unexplained=0.04,
        look_alikes=(("backlash", "stiction"),), margin=(508.0, "rate_limit"), verdict="",
        reasons=(Note("evidence", "It also holds on samples the fit did not see."),),
        warnings=(Note("short", "the record is short"),), series=series(), settings=SETTINGS,
        final=Fitness(0.0079, 0.008), model=replace(MODEL, loop=loop), details={"seconds": float("nan")},
    )


def nothing(loop: str = "FIC102") -> Explanation:
    e = explanation(loop)
    return replace(e, steps=e.steps[:1], effects=(), missing_effect=None, look_alikes=(), margin=None, verdict="",
                   reasons=(), final=BASELINE, where_before=(), warnings=())


def comparison(loop: str = "FIC101", *, model: Model | None = MODEL) -> Comparison:
    _, _, plain, _ = signals()
    if model is None:
        return Comparison(loop, BASELINE, 0.0075, fitness=BASELINE, where=regions(), series=series(plain),
                          settings=SETTINGS, unexplained=1.0)
    return Comparison(loop, BASELINE, 0.0075, fitness=Fitness(0.0079, 0.0081), where=regions(), effects=(backlash(),),
                      unexplained=0.05, series=series(), settings=SETTINGS, model=replace(model, loop=loop),
                      fitted=False, seen=0.0)
