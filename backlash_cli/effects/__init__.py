"""Physical effects, in the order a signal meets them between controller and historian.

To add one: write it in the same shape (`backlash.py` shows it), its sentences and numbers in words.toml, and list it
here, or keep it outside with these and name it `module:NAME`."""

from . import actuator_speed, backlash, curves, loads, process, recording
from .shape import Effect, Parameter, Stage

EFFECTS: tuple[Effect, ...] = (actuator_speed.RATE_LIMIT, actuator_speed.UNEQUAL_SPEED, backlash.EFFECT,
    backlash.STICTION, curves.SATURATION, curves.VALVE_CHARACTERISTIC, process.DEAD_TIME, process.SECOND_LAG,
    process.GAIN_DRIFT, loads.LOAD_STEP, loads.LOAD_DRIFT, loads.EXTERNAL_OSCILLATION, loads.MEASURED_DISTURBANCE,
    loads.RANDOM_LOAD, backlash.SENSOR_HYSTERESIS, curves.SENSOR_CURVE, loads.MEASUREMENT_NOISE, recording.QUANTIZATION,
    recording.EXCEPTION_COMPRESSION)

__all__ = ["EFFECTS", "Effect", "Parameter", "Stage"]
