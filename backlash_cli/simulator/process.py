"""The process of a simulated loop: a linear model with dead time, sampled exactly for a held input."""

from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MetadataError
from ..record import FloatArray, Frozen

ComplexArray = NDArray[np.complex128]


class Process(Frozen):
    """G(s) = gain * numerator(s)/denominator(s) * prod 1/(1 + s lag) * (1/s if integrating) * exp(-s dead_time).

    Coefficients start with the highest power of s. gain: measurement span per output span (per second if
    integrating). lags, dead_time: seconds. source: "given" or "fitted"; evidence: fall of -2 log likelihood that a
    fitted one brings; profile: (dead band, evidence) of smaller dead bands with it. Raises MetadataError for negative
    times or a model that is not causal."""

    gain: float = 1.0
    lags: tuple[float, ...] = ()
    dead_time: float = 0.0
    integrating: bool = False
    numerator: tuple[float, ...] = (1.0,)
    denominator: tuple[float, ...] = (1.0,)
    source: str = "given"
    evidence: float | None = None
    profile: tuple[tuple[float, float], ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        for name in ("lags", "numerator", "denominator"):
            try:
                object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
            except (TypeError, ValueError):
                raise MetadataError(f"{name} = {getattr(self, name)!r} is not a list of numbers") from None
        if not np.isfinite([*self.lags, *self.numerator, *self.denominator]).all():
            raise MetadataError("lags, numerator or denominator hold a value that is not finite")
        if not np.isfinite(self.gain) or self.gain == 0.0:
            raise MetadataError(f"process gain {self.gain:g} is not possible", remedy="give a gain other than 0")
        if any(lag <= 0.0 for lag in self.lags):
            raise MetadataError(f"a lag of {min(self.lags):g} s is not possible", remedy="give lags above 0 s")
        if not 0.0 <= self.dead_time < np.inf:
            raise MetadataError(f"a dead time of {self.dead_time:g} s is not possible", remedy="0 s or more")
        if not np.any(self.denominator) or self.denominator[0] == 0.0 or not np.any(self.numerator):
            raise MetadataError("the transfer function has no leading coefficient", remedy="drop leading zeros")
        order = len(self.denominator) - 1 + len(self.lags) + int(self.integrating)
        if len(np.trim_zeros(self.numerator, "f")) - 1 >= order:
            raise MetadataError("the process answers at once: numerator degree is not below denominator degree",
                                remedy="add a lag, for example lags = [1.0]")

    @property
    def static_gain(self) -> float | None:
        """Kp = G(0), None for an integrating process."""
        if self.integrating or self.denominator[-1] == 0.0:
            return None
        return self.gain * self.numerator[-1] / self.denominator[-1]

    def response(self, omega: object) -> ComplexArray:
        """G(i omega) for frequencies [rad/s]."""
        s = 1j * np.asarray(omega, dtype=np.float64)
        value = self.gain * np.polyval(self.numerator, s) / np.polyval(self.denominator, s)
        for lag in self.lags:
            value = value / (1.0 + s * lag)
        if self.integrating:
            value = value / s
        return np.asarray(value * np.exp(-s * self.dead_time), dtype=np.complex128)

    def sampled(self, step: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, int]:
        """Return the exact model for an input held over `step` seconds, fractional dead time included.

        decay, newer, older, readout, delay of x[k+1] = decay x[k] + newer u[k-delay] + older u[k-delay-1],
        y[k] = readout x[k]."""
        from scipy.signal import cont2discrete

        a, b, c = self._state_space()
        whole = int(np.floor(self.dead_time / step + 1e-9))
        late = max(self.dead_time - whole * step, 0.0)

        def held(time: float) -> tuple[FloatArray, FloatArray]:
            ad, bd, *_ = cont2discrete((a, b, c, np.zeros((1, 1))), time, method="zoh")
            return ad, bd

        # within one sample the older input acts for `late` seconds, then the newer one
        first, second = held(late), held(step - late)
        older = (second[0] @ first[1])[:, 0].copy()
        return np.ascontiguousarray(held(step)[0]), second[1][:, 0].copy(), older, c[0].copy(), whole

    def _state_space(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Chain of small blocks: far better conditioned than one polynomial of high order."""
        from scipy.signal import tf2ss

        numerator, denominator = np.trim_zeros(np.array(self.numerator), "f"), np.array(self.denominator)
        poles = [*((lag, 1.0) for lag in self.lags), *([(1.0, 0.0)] if self.integrating else [])]
        while len(numerator) > len(self.denominator) and poles:  # no block may answer before its input
            denominator = np.polymul(denominator, poles.pop(0))
        blocks: list[Any] = [(np.array([[-low / high]]), np.array([[1 / high]]), np.eye(1), np.zeros((1, 1)))
                             for high, low in poles]
        scale = numerator[-1] / denominator[0]
        if len(denominator) > 1:
            blocks.append(tf2ss(numerator, denominator))
            scale = 1.0
        a, b, c, d = blocks[0]
        for next_a, next_b, next_c, next_d in blocks[1:]:
            a = np.block([[a, np.zeros((len(a), len(next_a)))], [next_b @ c, next_a]])
            b, c, d = np.vstack([b, next_b @ d]), np.hstack([next_d @ c, next_c]), next_d @ d
        return a, b * scale, c * self.gain
