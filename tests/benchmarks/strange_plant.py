"""One control loop of a plant, integrated in time as it stands there; the laws of the simulator `strangers`.

It shares nothing with `backlash_cli`. Signals in percent of span, times in seconds.
"""

import math
from types import SimpleNamespace

import numpy as np
from numba import njit

KARNOPP, LUGRE = 1, 2


@njit(cache=True)
def friction_step(kind, x, v, z, p, target, lag, steps, h, up, down):  # type: ignore[no-untyped-def]
    """Move a spring-opposed valve stem by `steps` of h seconds; returns stem x, its speed v, bristles z, pressure p.

    m x'' = p - x - b x' - friction, all forces in % of the travel the spring gives. up, down: (break-away, sliding)
    friction when opening and closing. Karnopp (1985), LuGre (Canudas de Wit et al., 1995).
    """
    a, mass, viscous, still, stiffness, stribeck = 1.0 - math.exp(-h / lag), 1e-3, 0.1, 0.02, 60.0, 0.1
    if kind == KARNOPP and v == 0.0:  # it will not break away within this step
        end = target + (p - target) * math.exp(-h * steps / lag)
        if -down[0] < min(p, end) - x and max(p, end) - x < up[0]:
            return x, 0.0, z, end
    for _ in range(steps):
        p += a * (target - p)
        net = p - x
        if kind == KARNOPP:
            if abs(v) < still and -down[0] <= net <= up[0]:
                v = 0.0
                continue
            opening = net > 0 if abs(v) < still else v > 0
            new = v + h / mass * (net - (up[1] if opening else -down[1]) - viscous * v)
            v = 0.0 if new * v < 0 else new
        else:
            level = up if v > 0 else down
            wall = level[1] + (level[0] - level[1]) * math.exp(-((v / stribeck) ** 2))
            bent = (z + h * v) / (1.0 + h * stiffness * abs(v) / wall)  # implicit: fast stems bend them within a step
            slip, z = (bent - z) / h, bent
            v += h / mass * (net - stiffness * z - 0.05 * slip - viscous * v)
        x += h * v
    return x, v, z, p


@njit(cache=True)
def between(table, at):  # type: ignore[no-untyped-def]
    """Value of a table that runs from 0 to 100 in steps of 0.1."""
    place = min(max(at * 10.0, 0.0), 999.999)
    i = int(place)
    return table[i] + (place - i) * (table[i + 1] - table[i])


@njit(cache=True)
def control_loop(dt, start, sp, load_in, load_out, noise, ff, manual, tuning, outer, lags, dead, integ, gain, fast,
                 flow, inverse, actuator, gaps, split, friction, op0, limits):  # type: ignore[no-untyped-def]
    """Run the loop once; returns SP, measured PV, OP, stem [%], and crossings of the gap from sample `start` on.

    sp, load_in, load_out, noise, ff: (n,) [%], deviations except sp; manual: (n,), NaN in automatic. tuning: K, Ti,
    Td, derivative filter, PV filter [s], gap half width [%], share of the error that counts inside the gap. outer: K
    (0: none), Ti, lag and gain of a master loop whose setpoint `sp` then is, share of the load that meets it. lags:
    (m,) [s]; dead: samples; integ: gain of an integrator [1/s] or 0; gain, fast: static gain, share of the path that
    skips all lags but the first. flow: flow of the valve against the stem; inverse: stem wanted against OP; both for
    0 to 100 % in steps of 0.1 %. actuator: lag [s], 1 when the play sits behind it. gaps: d of the first and of the
    second valve, change of d per 10 % of travel, place of the stem in the gap at the start (-1 to 1). split: OP where
    the second valve takes over, its flow against the first. friction: kind (0: none), break-away and sliding up, the
    same down.
    """
    n, m = len(sp), len(lags)
    y_sp, y, op, stem = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    K, Ti, Td, Tn, Tf, gap, inside = tuning
    decay = 1.0 - np.exp(-dt / lags)
    a_valve = 1.0 - math.exp(-dt / actuator[0]) if actuator[0] > 0 else 1.0
    a_pv, a_d = (1.0 - math.exp(-dt / Tf) if Tf > 0 else 1.0), (1.0 - math.exp(-dt / Tn) if Tn > 0 else 1.0)
    x, level, line, at = np.zeros(m), 0.0, np.zeros(dead + 1), 0
    pv0, first = sp[0], between(inverse, op0)
    total, filtered, slow, lagged = 0.0, pv0, pv0, first
    base = np.array([min(first, split[0]), max(first, split[0])])
    pos, side, crossings = base + gaps[3] * gaps[:2] / 2, np.zeros(2), 0
    place, v, z, p, flow0 = first, 0.0, 0.0, first, between(flow, first)
    substeps = round(dt / 0.002)
    upper, upper_total = 0.0, 0.0
    for k in range(n):
        moved = level if integ != 0 else gain * (x[m - 1] + fast * (x[0] - x[m - 1]))
        true = pv0 + moved + load_out[k]
        wanted = sp[k]
        if outer[0] != 0:
            upper += dt / outer[2] * (outer[3] * (true - pv0) + load_in[k] * outer[4] - upper)
            error = 0.3 * (sp[k] - pv0) - upper
            upper_total += dt / outer[1] * error * outer[0]
            wanted = pv0 + outer[0] * error + upper_total
        # controller: derivative on PV, back-calculated integral at the limits and in manual
        filtered += a_pv * (true + noise[k] - filtered)
        rate = (filtered - slow) * a_d / dt
        slow += a_d * (filtered - slow)
        error = wanted - filtered
        error = inside * error if abs(error) < gap else error - math.copysign((1.0 - inside) * gap, error)
        total += K * error * dt / Ti
        fixed = op0 + K * (error - Td * rate) + ff[k]
        u = min(max(fixed + total, limits[0]), limits[1]) if math.isnan(manual[k]) else manual[k]
        total = u - fixed
        y_sp[k], y[k], op[k] = wanted, true + noise[k], u
        # valve
        demand = between(inverse, u)
        if friction[0] > 0:
            place, v, z, p = friction_step(int(friction[0]), place, v, z, p, demand, max(actuator[0], 0.05), substeps,
                                           dt / substeps, friction[1:3], friction[3:5])
        else:
            if actuator[1] > 0:
                lagged += a_valve * (demand - lagged)
                demand = lagged
            place = first
            for i in range(2):
                target = min(demand, split[0]) if i == 0 else max(demand, split[0])
                half = gaps[i] / 2 * max(0.2, 1.0 + gaps[2] * (demand - first) / 10.0)
                contact = 1 if pos[i] <= target - half else -1 if pos[i] >= target + half else 0
                pos[i] = min(max(pos[i], target - half), target + half)
                if half > 0 and contact != 0:
                    crossings += contact == -side[i] and k >= start
                    side[i] = contact
                place += (pos[i] - base[i]) * (1.0 if i == 0 else split[1])
            if actuator[1] <= 0:
                lagged += a_valve * (place - lagged)
                place = lagged
        stem[k] = place
        # process
        line[at] = between(flow, place) - flow0
        at = (at + 1) % (dead + 1)
        inflow = line[at] + load_in[k] * (1.0 - outer[4])
        for j in range(m):
            x[j] += decay[j] * (inflow - x[j])
            inflow = x[j]
        level += dt * integ * x[m - 1]
    return y_sp, y, op, stem, crossings


@njit(cache=True)
def reversals(signal, size):  # type: ignore[no-untyped-def]
    """How often a signal turned by more than `size`: a zigzag that leaves out smaller turns."""
    low = high = signal[0]
    side = count = 0
    for value in signal:
        high, low = (max(high, value) if side >= 0 else high), (min(low, value) if side <= 0 else low)
        if side >= 0 and value < high - size:
            count, side, low = count + (side > 0), -1, value
        elif side <= 0 and value > low + size:
            count, side, high = count + (side < 0), 1, value
    return count


@njit(cache=True)
def exception_report(signal, size):  # type: ignore[no-untyped-def]
    """What a historian keeps that stores a value only when it differs by `size` from the last one stored."""
    out = signal.copy()
    for i in range(1, len(out)):
        if abs(out[i] - out[i - 1]) < size:
            out[i] = out[i - 1]
    return out


@njit(cache=True)
def swinging_door(signal, size):  # type: ignore[no-untyped-def]
    """Which samples (n,), at even times, a historian keeps so that straight lines through them miss none by `size`."""
    kept = np.zeros(len(signal), np.bool_)
    kept[0] = kept[-1] = True
    last, low, high = 0, -np.inf, np.inf
    for i in range(1, len(signal)):
        if not low <= (signal[i] - signal[last]) / (i - last) <= high:
            last, low, high = i - 1, -np.inf, np.inf
            kept[last] = True
        low = max(low, (signal[i] - size - signal[last]) / (i - last))
        high = min(high, (signal[i] + size - signal[last]) / (i - last))
    return kept


def gain_margin(it: SimpleNamespace) -> float:
    """Gain margin of the linear loop: how much more gain it stands. it: names as in `control_loop`."""
    lags, dead = np.r_[it.lags, max(it.Tf, 0.01), max(it.actuator[0], 0.01)], it.theta + it.dt
    w = np.geomspace(1e-4 / (lags.sum() + dead + it.Ti), 30 / (lags.min() + 0.02 * dead), 3000)
    s = 1j * w
    parts = 1 / (1 + s[:, None] * lags)
    slow, quick = parts.prod(1), parts[:, 0]
    process = it.integ / s * slow if it.integ else it.gain * (slow + it.fast * (quick - slow))
    chain = it.K * (1 + 1 / (it.Ti * s) + it.Td * s / (1 + 0.1 * it.Td * s)) * process
    phase = np.unwrap(np.angle(chain)) - w * dead
    phase -= 2 * np.pi if phase[0] > 0.2 else 0
    down = np.flatnonzero((phase[:-1] > -np.pi) & (phase[1:] <= -np.pi))
    return float(1 / abs(chain[down[0]])) if len(down) else 1e3
