"""The closed loop on the desk: describe a loop as a Scenario, `simulate` it to a Record, `trace` it to see inside.

>>> scenario = Scenario(Controller(K=1.2, Ti=2.2, Td=1.2), Process(lags=(1, 1, 1, 1)), duration=10, step=0.01,
...                     effects=(use("backlash", d=0.05), use("load_step", times=[1.0], sizes=[0.2])))
>>> len(simulate(scenario))
1000"""

from .controller import Compensator, Controller, Scheme
from .loop import Trace, export, simulate, trace
from .process import Process
from .scenario import Applied, Manual, Recorder, Scenario, Signal, use

__all__ = ["Applied", "Compensator", "Controller", "Manual", "Process", "Recorder", "Scenario", "Scheme", "Signal",
           "Trace", "export", "simulate", "trace", "use"]
