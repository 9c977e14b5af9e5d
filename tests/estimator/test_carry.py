"""The cut at midnight: two nights joined in any order give the half periods of the uncut record."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from backlash_cli.estimator.carry import pack, resume, unpack
from backlash_cli.estimator.haegglund import estimate
from backlash_cli.record import SampleState, record_from_arrays
from backlash_cli.scanning import ScanOptions, scan
from tests.test_scan import RECORD

KEEP = ScanOptions(confirm=False, carry=True)


def night(record, first, last):
    """A night as exported by itself: its own start, grid from 0."""
    block = record.slice(first, last)
    return replace(block, start=record.start + first * record.interval, index=block.index - first)


def joined(record, cuts, offset=0):
    """Begin times of the accepted half periods of a record exported night by night, joined by the carried states."""
    edges = [0, *cuts, len(record)]
    found, tail, before = {}, None, 0
    for first, last in pairwise(edges):
        part = night(record, first, last)
        report = scan(part, KEEP)
        carry = unpack(report.carry)
        own = [(e.start, e.d) for e in report.estimates if e.accepted]
        passed = None
        if tail is not None:
            done, until, passed = resume(tail, carry, before - first)
            until = np.inf if until is None else until
            own = [(start, d) for start, d in own if start - part.start >= until * part.interval - 1e-6]
            joint = estimate(done, part.interval, report.settings, part.start)
            own += [(e.start, e.d) for e in joint if e.accepted]
        found.update(own)
        tail, before = passed or carry.tail, first
    return np.array(sorted(found.items()))


def whole(record):
    return np.array(sorted((e.start, e.d) for e in scan(record, KEEP).estimates if e.accepted))


@pytest.mark.parametrize("cut", [50, 777, 1500, 3000, 5900])
def test_two_halves_of_a_day_give_the_half_periods_of_the_day(cut):
    np.testing.assert_allclose(joined(RECORD, [cut]), whole(RECORD), rtol=1e-6, atol=1e-6)


PLACES = st.integers(1, len(RECORD) // 3 - 1).map(lambda i: 3 * i)


@given(st.lists(PLACES, min_size=1, max_size=12, unique=True), st.booleans())
@example(cuts=[2001, 2004], manual=True)  # three samples, none of them usable
@example(cuts=[1998, 2001], manual=True)
@example(cuts=[2001, 2301], manual=True)  # a night in manual
@settings(max_examples=25, deadline=None)
def test_any_number_of_nights_joined_equals_the_uncut_record(cuts, manual):
    record = RECORD
    if manual:
        state = RECORD.state.copy()
        state[2000:2400] = SampleState.MANUAL
        state[4000:4010] = SampleState.MISSING
        record = replace(RECORD, state=state)
    a, b = joined(record, sorted(cuts)), whole(record)
    assert len(a) == len(b)
    np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-5)


def test_packing_is_exact_and_the_same_every_time():
    data = scan(RECORD, KEEP).carry
    carry = unpack(data)
    assert pack(carry) == data
    # the first half period after the filters have settled ends the head
    assert carry.until < carry.head[0][-1] < carry.until + 2 and len(carry.head[0]) < 0.1 * len(RECORD)


def test_the_travel_of_the_output_leaves_out_what_does_not_move_a_valve():
    output = np.concatenate([np.linspace(0.4, 0.6, 1801), np.linspace(0.6, 0.4, 1801)[1:]])
    for wiggle in (0.0, 0.002):
        noisy = output + wiggle * (-1.0) ** np.arange(3601)
        record = record_from_arrays(0.5, np.full(3601, 0.5), noisy, interval=1.0, settings=RECORD.settings)
        assert unpack(scan(record, KEEP).carry).travel == pytest.approx(0.4, abs=0.01)


def test_nights_with_other_filters_do_not_fit():
    carry = unpack(scan(RECORD, KEEP).carry)
    assert carry.fits(carry) and not carry.fits(replace(carry, Ti=9.0))
