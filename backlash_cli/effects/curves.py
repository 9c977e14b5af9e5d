"""Curves: what is not proportional, without any memory: stops, valve characteristic, scale of the sensor.

Saturation: the valve meets a stop before the end of the output's range.

>>> SATURATION.apply([0.1, 0.9], SATURATION.pack(low=0.2, high=0.8), interval=1.0).tolist()
[0.2, 0.8]

Valve characteristic: the flow through the valve is not proportional to its travel.
flow = (exp(c x) - 1) / (exp(c) - 1) maps travel 0..1 to flow 0..1. The slope grows or falls by exp(c) over the
travel: c > 0 is equal percentage with rangeability R = exp(c), c < 0 is quick opening, c = 0 is linear. In series
with a pipe the flow becomes q / sqrt(a + (1 - a) q^2), a the share of the pressure drop over the open valve.

>>> p = VALVE_CHARACTERISTIC.pack(curvature=3.0)
>>> VALVE_CHARACTERISTIC.apply([0.0, 0.5, 1.0], p, interval=1.0).round(3).tolist()
[0.0, 0.182, 1.0]
>>> p = VALVE_CHARACTERISTIC.pack(curvature=-3.0)
>>> VALVE_CHARACTERISTIC.apply([0.0, 0.5, 1.0], p, interval=1.0).round(3).tolist()
[0.0, 0.818, 1.0]

Curved sensor: PV is not proportional to what is measured, for example a flow whose root was never taken. It is the
same curve as a valve's, over the span of PV: c < 0 is steep at the low end, as a root is, c > 0 at the high end.

>>> SENSOR_CURVE.apply([0.0, 0.25, 0.5, 1.0], SENSOR_CURVE.pack(curvature=-2.0), interval=1.0).round(3).tolist()
[0.0, 0.455, 0.731, 1.0]"""

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values, Whole
from .shape import Stage, Step, effect


def no_memory(*_: object) -> FloatArray:
    return np.empty(0)


def at_once(step: Step) -> Whole:
    """Return the way over all samples of a step without memory, whose formula takes an array as well as a number."""
    return lambda values, p, interval: step(np.empty(0), values, p)  # type: ignore[arg-type, return-value]


def stop_step(state: FloatArray, value: float, p: FloatArray) -> float:
    return np.minimum(np.maximum(value, p[0]), p[1])


def stops(clues: Clues) -> list[Values]:
    """Return stops at either side that the output passes for a small up to a large share of the time."""
    shares = (0.02, 0.06, 0.12, 0.2, 0.3, 0.45)
    return [{name: float(np.quantile(clues.output, abs(side - share)))}
            for name, side in (("low", 0.0), ("high", 1.0)) for share in shares]


SATURATION = effect("saturation", Stage.VALVE, no_memory, stop_step, fitting=Fitting(whole=at_once(stop_step),
    propose=stops))


def flow_step(state: FloatArray, value: float, p: FloatArray) -> float:
    flow = value if p[0] == 0.0 else np.expm1(p[0] * value) / np.expm1(p[0])
    # a sensor has no pipe in series
    return flow if p.size == 1 or p[1] == 1.0 else flow / np.sqrt(p[1] + (1.0 - p[1]) * flow * flow)


# gentle to strong curves, bent either way, and linear valves with little to much pipe in series
BENDS: list[Values] = [{"curvature": c} for c in (-4.0, -2.0, -0.8, 0.8, 2.0, 4.0)]
BENDS += [{"authority": a} for a in (0.1, 0.3, 0.6)]
VALVE_CHARACTERISTIC = effect("valve_characteristic", Stage.VALVE, no_memory, flow_step,
    fitting=Fitting(whole=at_once(flow_step), propose=lambda clues: BENDS, rivals=("sensor_curve",)))

SENSOR_CURVE = effect("sensor_curve", Stage.SENSOR, no_memory, flow_step, fitting=Fitting(whole=at_once(flow_step),
    seldom=True, rivals=("valve_characteristic",)))
