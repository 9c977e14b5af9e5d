"""Physical effects, one small file each, in the order a signal meets them between controller and historian.

To add one: write a file of the same shape and list it here, or keep it outside and name it `module:NAME`.
"""

from . import (
    backlash,
    dead_time,
    exception_compression,
    external_oscillation,
    load_drift,
    load_step,
    measured_disturbance,
    measurement_noise,
    quantization,
    random_load,
    rate_limit,
    saturation,
    second_lag,
    stiction,
    valve_characteristic,
)
from .shape import Effect, Parameter, Stage

EFFECTS: tuple[Effect, ...] = (
    rate_limit.EFFECT,
    backlash.EFFECT,
    stiction.EFFECT,
    saturation.EFFECT,
    valve_characteristic.EFFECT,
    dead_time.EFFECT,
    second_lag.EFFECT,
    load_step.EFFECT,
    load_drift.EFFECT,
    external_oscillation.EFFECT,
    measured_disturbance.EFFECT,
    random_load.EFFECT,
    measurement_noise.EFFECT,
    quantization.EFFECT,
    exception_compression.EFFECT,
)

__all__ = ["EFFECTS", "Effect", "Parameter", "Stage"]
