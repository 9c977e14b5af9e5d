"""A square wave in block means: its values, and the one that OP shows when a load switches to and fro."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray

FEWEST_HALF_PERIODS = 12
IN_LINES = 0.6  # of OP's variance up to NOISE times the frequency in the fundamental and its first odd harmonics
NOISE = 8.0
THIRD = 0.12  # third harmonic of PV over its fundamental: a square load leaves more, a sine nothing
HARMONICS = (1, 3, 5, 7)
PRESENT = 0.8  # of the rows: the lines of a record in pieces are not sharp
NEARLY = 0.9  # of IN_LINES at the first guess of the frequency, before it is refined
LINE = 2.0  # half width of a line behind a Hann window, in bins


@dataclass(frozen=True)
class Wave:
    """A square wave: amplitude [span], half period and phase [rows], the phase a switch up counted from the middle."""

    amplitude: float
    half: float
    phase: float


@numba.njit(cache=True, nogil=True, error_model="numpy")
def square(rows_from_middle: NDArray[Any], half: float, phase: float) -> NDArray[Any]:
    """Return the means over each row (one row long) of a wave of +1 and -1; exact, so smooth in half and phase."""
    out = np.empty(len(rows_from_middle))
    for k in range(len(out)):
        at = rows_from_middle[k] - phase
        out[k] = _area(at + 1.0, half) - _area(at, half)
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _area(time: float, half: float) -> float:
    turn = time - 2.0 * half * np.floor(time / (2.0 * half))
    return float(min(turn, 2.0 * half - turn))


def opposed_wave(output: FloatArray, measurement: FloatArray, at: IntArray) -> Wave | None:
    """Return the square load that OP (rows,) seems to oppose, None where OP and PV do not swing like that.

    at (rows,): row numbers, with holes. OP answers late and not sharply, so phase and amplitude are a start for a
    fit; the half period, a joint fit of the odd harmonics, is close.
    """
    time = (at - at[0]).astype(float)
    span = int(time[-1]) + 1
    if span < 4 * FEWEST_HALF_PERIODS or len(at) < PRESENT * span:
        return None
    u = _windowed(output, at, span)
    power = np.abs(np.fft.rfft(u)) ** 2
    fine = 1 << (4 * span - 1).bit_length()
    padded = np.abs(np.fft.rfft(u, fine)) ** 2
    first, last = (2 * FEWEST_HALF_PERIODS - 4) * fine // (4 * span), fine // 8
    if last <= first:
        return None
    frequency = (first + int(np.argmax(padded[first:last]))) / fine
    if _share(power, span, frequency) < NEARLY * IN_LINES:
        return None
    grid = frequency + np.linspace(-1.0, 1.0, 41) / (4.0 * span)
    frequency = float(grid[int(np.argmax(sum(np.abs(fourier_sums(u, grid * m)) ** 2 for m in HARMONICS[:3])))])
    half = 0.5 / frequency
    if span / half < FEWEST_HALF_PERIODS or _share(power, span, frequency) < IN_LINES:
        return None
    of_pv = np.abs(np.fft.rfft(_windowed(measurement, at, span))) ** 2
    if _band(of_pv, span, 3 * frequency) < THIRD**2 * _band(of_pv, span, frequency):
        return None
    swing = complex(np.sum(u * np.exp(-2j * np.pi * frequency * (np.arange(span) - 0.5 * time[-1]))))
    phase = (-(np.angle(swing) + 1.5 * np.pi) / (2.0 * np.pi * frequency) + half) % (2.0 * half) - half
    return Wave(0.25 * np.pi * 4.0 * abs(swing) / span, half, float(phase))


def fourier_sums(x: FloatArray, frequencies: FloatArray) -> NDArray[np.complex128]:
    """Return the sums (frequencies,) of x (rows,), each times exp(-2 pi i frequency row); frequencies: periods a row.

    Rows are taken as those of a square: a phase is that of where a line of it begins, and that within the line. A
    hundred waves are then worked out for two thousand rows in place of two thousand.
    """
    side = int(np.ceil(np.sqrt(max(len(x), 1))))
    lines = np.zeros(side * side)
    lines[: len(x)] = x
    square = lines.reshape(side, side)
    phase = 2.0 * np.pi * frequencies[:, None] * np.arange(side)
    cosines, sines = np.cos(phase) @ square.T, np.sin(phase) @ square.T
    begin = np.cos(side * phase), np.sin(side * phase)
    sums: NDArray[np.complex128] = (np.sum(begin[0] * cosines - begin[1] * sines, axis=1)
                                    - 1j * np.sum(begin[0] * sines + begin[1] * cosines, axis=1))
    return sums


def _windowed(x: FloatArray, at: IntArray, span: int) -> FloatArray:
    even = np.zeros(span)
    even[at - at[0]] = x - x.mean()
    return np.asarray(even * np.hanning(span))


def _band(power: FloatArray, span: int, frequency: float) -> float:
    centre = frequency * span
    return float(power[max(int(centre - LINE), 1) : int(np.ceil(centre + LINE)) + 1].sum())


def _share(power: FloatArray, span: int, frequency: float) -> float:
    total = float(np.sum(power[1 : int(NOISE * frequency * span) + 1]))
    return sum(_band(power, span, m * frequency) for m in HARMONICS) / total if total > 0 else 0.0
