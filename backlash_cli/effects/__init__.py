"""Physical effects, one small file each, in the order a signal meets them between controller and historian.

To add one: write a file of the same shape and list it here, or keep it outside and name it `module:NAME`.
"""

from . import (
    backlash,
    dead_time,
    exception_compression,
    external_oscillation,
    gain_drift,
    load_drift,
    load_step,
    measured_disturbance,
    measurement_noise,
    quantization,
    random_load,
    rate_limit,
    saturation,
    second_lag,
    sensor_curve,
    sensor_hysteresis,
    stiction,
    unequal_speed,
    valve_characteristic,
)
from .shape import Effect, Parameter, Stage

EFFECTS: tuple[Effect, ...] = (
    rate_limit.EFFECT,
    unequal_speed.EFFECT,
    backlash.EFFECT,
    stiction.EFFECT,
    saturation.EFFECT,
    valve_characteristic.EFFECT,
    dead_time.EFFECT,
    second_lag.EFFECT,
    gain_drift.EFFECT,
    load_step.EFFECT,
    load_drift.EFFECT,
    external_oscillation.EFFECT,
    measured_disturbance.EFFECT,
    random_load.EFFECT,
    sensor_hysteresis.EFFECT,
    sensor_curve.EFFECT,
    measurement_noise.EFFECT,
    quantization.EFFECT,
    exception_compression.EFFECT,
)

__all__ = ["EFFECTS", "Effect", "Parameter", "Stage"]
