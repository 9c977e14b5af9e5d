"""The controller of a simulated loop: PID (2) with measurement filter (3), and backlash compensation (7), (8), (9)."""

from dataclasses import replace
from enum import IntEnum

import numpy as np

from ..errors import MetadataError
from ..record import FloatArray, Frozen, LoopSettings
from .process import ComplexArray


class Controller(Frozen):
    """u = K ( b ysp - yf + 1/Ti int(ysp - yf) dt + Td d(c ysp - yf)/dt ),  Yf = Y / (1 + s Tf)^2.

    K: output span per measurement span; negative for a process with negative gain. Ti, Td, Tf: seconds; Tf is by
    default Td/5 (PID) or Ti/10 (PI). b, c: setpoint weights, 0 in the paper. low, high: output limits.
    tracking_time: anti-windup by back calculation [s], default sqrt(Ti Td) (PID) or Ti (PI).
    Source: Haegglund (2007), eqs 2 and 3; anti-windup Astrom and Haegglund, Advanced PID Control (2006)."""

    K: float
    Ti: float
    Td: float = 0.0
    Tf: float | None = None
    b: float = 0.0
    c: float = 0.0
    low: float = -np.inf
    high: float = np.inf
    tracking_time: float | None = None

    def __post_init__(self) -> None:
        if not np.isfinite(self.K) or self.K == 0.0:
            raise MetadataError(f"K = {self.K:g} is not possible", where="controller", remedy="a gain other than 0")
        for name, least in (("Ti", 1e-12), ("Td", 0.0), ("Tf", 0.0), ("tracking_time", 1e-12)):
            value = getattr(self, name)
            if value is not None and not least <= value < np.inf:
                raise MetadataError(f"{name} = {value:g} is not possible", where="controller",
                                    remedy=f"{name} is a time in seconds")
        if self.Td > 0.0 and self.Tf == 0.0:
            raise MetadataError("a derivative part needs a filter", where="controller", remedy="leave Tf out: Td/5")
        if not self.low < self.high:
            raise MetadataError(f"output limits {self.low:g} .. {self.high:g} leave no room", where="controller")

    @classmethod
    def of(cls, settings: LoopSettings, **limits: float) -> "Controller":
        """The controller of a loop whose K and Ti are known. No filter beside a Td means that nobody wrote one down."""
        assert settings.K is not None and settings.Ti is not None
        filter_time = (settings.Tf or None) if settings.Td else settings.Tf
        return cls(settings.K, settings.Ti, settings.Td, filter_time, **limits)

    @property
    def filter_time(self) -> float:
        """Tf [s] of (3): as given, else Td/5 or Ti/10."""
        return LoopSettings(K=self.K, Ti=self.Ti, Td=self.Td, Tf=self.Tf).filter_time or 0.0

    def response(self, omega: object) -> ComplexArray:
        """C(i omega) from measurement to minus the output: K (1 + 1/(s Ti) + s Td) / (1 + s Tf)^2."""
        s = 1j * np.asarray(omega, dtype=np.float64)
        pid = self.K * (1.0 + 1.0 / (s * self.Ti) + s * self.Td)
        return np.asarray(pid / (1.0 + s * self.filter_time) ** 2, dtype=np.complex128)

    def packed(self, sample_time: float) -> FloatArray:
        """Numbers for the kernel, in its order."""
        windup_time = self.tracking_time or (np.sqrt(self.Ti * self.Td) if self.Td > 0.0 else self.Ti)
        derivative = self.K * self.Td / self.filter_time if self.Td > 0.0 else 0.0
        return np.array([self.K, self.K * sample_time / self.Ti, derivative, self.b, self.c, self.low, self.high,
                         min(sample_time / windup_time, 1.0), *lag_pair(self.filter_time, sample_time)])


class Scheme(IntEnum):
    """How the compensator decides on its sign: equations of the paper."""

    NONE = 0
    OUTPUT = 7
    FILTERED_OUTPUT = 8
    ERROR = 9


class Compensator(Frozen):
    """Adds gain/2 * sign(...) to the output so that it jumps through the gap at every reversal.

    gain: span of output. scheme: (7) sign of the output's change, (8) of the filtered output's change, (9) of the
    control error. filter_time: seconds, for (8) default Td/5 (PID) or Ti/10 (PI), eq. 10, for (9) an extra filter of
    the error, default none. hysteresis: the error must pass this far beyond zero before the sign of (9) changes."""

    gain: float = 0.0
    scheme: Scheme = Scheme.ERROR
    filter_time: float | None = None
    hysteresis: float = 0.0

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "scheme", Scheme(self.scheme))
        except ValueError:
            raise MetadataError(f"no compensator scheme {self.scheme}", remedy="7, 8 or 9 (0: none)") from None
        for name in ("gain", "hysteresis", "filter_time"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value < np.inf:
                raise MetadataError(f"{name} = {value:g} is not possible", where="compensator", remedy="0 or more")

    def packed(self, controller: Controller, sample_time: float) -> FloatArray:
        """Numbers for the kernel, in its order."""
        filter_time = self.filter_time or 0.0
        if self.filter_time is None and self.scheme is Scheme.FILTERED_OUTPUT:
            filter_time = replace(controller, Tf=None).filter_time
        return np.array([self.scheme if self.gain > 0.0 else Scheme.NONE, 0.5 * self.gain,
                         self.hysteresis if self.scheme is Scheme.ERROR else 0.0, *lag_pair(filter_time, sample_time)])


def lag_pair(filter_time: float, sample_time: float) -> tuple[float, float]:
    """Return (a, h/T a): x1 and x2 of 1/(1 + s T)^2 for a held input go to a x1 + ..., a x2 + (h/T) a x1 + ... ."""
    ratio = sample_time / filter_time if filter_time > 0.0 else 1e3
    return float(np.exp(-ratio)), float(ratio * np.exp(-ratio))
