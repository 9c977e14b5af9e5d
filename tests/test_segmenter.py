"""The compiled segmenter against a sample-by-sample walk, and its independence of the cut into blocks."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.segmenter import Segments, close, segment


def walk(e, sp, index):
    """Return half periods (begin, end, area, peak, sign, move, complete) by brute force on one stretch at a time."""
    out, i = [], 0
    while i < len(e):
        j = i
        while j + 1 < len(e) and index[j + 1] == index[j] + 1:
            j += 1
        out += _walk_stretch(e[i : j + 1], sp[i : j + 1], index[i])
        i = j + 1
    return out


def _walk_stretch(e, sp, offset):
    signs, last = [], 0
    for v in e:
        last = int(np.sign(v)) or last
        signs.append(last)
    result = []
    begin, crossed, area, peak, move, sign = float(offset), False, 0.0, abs(e[0]), 0.0, signs[0]
    for k in range(1, len(e)):
        if signs[k] != signs[k - 1] and signs[k - 1] != 0:
            f = e[k - 1] / (e[k - 1] - e[k])
            area += 0.5 * abs(e[k - 1]) * f
            result.append((begin, offset + k - 1 + f, area, peak, sign, move, crossed))
            begin, crossed, area, peak = offset + k - 1 + f, True, 0.5 * abs(e[k]) * (1 - f), abs(e[k])
            move, sign = abs(sp[k] - sp[k - 1]), signs[k]
        else:
            area += 0.5 * (abs(e[k - 1]) + abs(e[k]))
            peak, move, sign = max(peak, abs(e[k])), move + abs(sp[k] - sp[k - 1]), signs[k]
    result.append((begin, offset + len(e) - 1.0, area, peak, sign, move, False))
    return [r for r in result if r[4] != 0]


def run(e, sp, index, cuts):
    parts, left = [], None
    for a, b in zip([0, *cuts], [*cuts, len(e)], strict=True):
        done, left = segment(e[a:b], sp[a:b], index[a:b], left)
        parts.append(done)
    return Segments.join([*parts, close(left)])


@st.composite
def records(draw):
    n = draw(st.integers(1, 60))
    values = st.sampled_from([-2.0, -1.0, -0.5, 0.0, 0.25, 1.0, 3.0])
    e = np.array(draw(st.lists(values, min_size=n, max_size=n)))
    sp = np.array(draw(st.lists(values, min_size=n, max_size=n)))
    jumps = draw(st.lists(st.sampled_from([1, 1, 1, 1, 1, 2, 7]), min_size=n, max_size=n))
    cuts = sorted(draw(st.lists(st.integers(0, n), max_size=5)))
    return e, sp, np.cumsum(jumps).astype(np.int64), cuts


@given(records())
@settings(max_examples=400, deadline=None)  # compiles on the first call
def test_any_cut_gives_what_a_walk_over_the_samples_gives(record):
    e, sp, index, cuts = record
    found = run(e, sp, index, cuts)
    expected = walk(e, sp, index)
    assert len(found) == len(expected)
    got = np.column_stack([found.begin, found.end, found.area, found.e_max, found.direction,
                           found.setpoint_move, found.complete])
    np.testing.assert_allclose(got, np.array(expected, float).reshape(-1, 7), atol=1e-12)


def test_a_sine_has_half_periods_of_known_length_and_area():
    period, amplitude = 40.0, 0.3
    k = np.arange(400)
    e = amplitude * np.sin(2 * np.pi * (k + 0.25) / period)
    s = run(e, np.zeros(400), k.astype(np.int64), [])
    whole = s.select(s.complete)
    np.testing.assert_allclose(whole.end - whole.begin, period / 2, atol=0.01)
    np.testing.assert_allclose(whole.area, amplitude * period / np.pi, rtol=0.003)
