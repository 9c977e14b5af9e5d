"""Stretches of a long record that are kept: against a plain look at all of them, byte for byte wherever it is cut."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.estimator.block_kernel import STRETCH
from backlash_cli.estimator.decimate import AT_ONCE, SHELVES, BlockMeans
from backlash_cli.estimator.kept import WHOLE, Kept, Stretch


def in_a_row(stretches: list[Stretch], most: int) -> list[list[Stretch]]:
    """All choices of neighbours without holes between them, each as long as `most` rows allow."""
    found = []
    for end in range(len(stretches)):
        choice = [stretches[end]]
        for s in reversed(stretches[:end]):
            joined = s.number + 1 == choice[0].number and s.rows >= WHOLE * STRETCH
            if not joined or s.rows + sum(x.rows for x in choice) > most:
                break
            choice.insert(0, s)
        found.append(choice)
    return found


@settings(deadline=None, max_examples=80)
@given(st.integers(0, 10_000), st.sampled_from((500, 1000, 2000)), st.floats(0.0, 0.4), st.integers(1, 60))
def test_the_stretches_chosen_are_those_of_a_look_at_all_of_them(seed: int, most: int, holes: float, n: int) -> None:
    rng = np.random.default_rng(seed)
    numbers = np.cumsum(rng.choice((1, 2), n, p=(1 - holes, holes)))
    rows = np.where(rng.random(n) < holes, rng.integers(1, STRETCH, n), STRETCH)
    travel = np.round(rng.random(n), 1)  # some equal
    every = [Stretch(int(a), float(t), int(r), 0) for a, t, r in zip(numbers, travel, rows, strict=True)]
    kept = Kept(most)
    dropped = [x for s in every[:-1] for x in kept.add(s)]
    long = [choice for choice in in_a_row(every, most) if sum(s.rows for s in choice) > most - STRETCH]
    travels = [sum(s.travel for s in choice) for choice in long]
    chosen = kept.chosen(every[-1])
    if travels and max(travels) > 0:
        assert chosen == long[int(np.argmax(travels))]
    else:
        calmest = sorted(every, key=lambda s: (s.travel, -s.number))
        while sum(s.rows for s in calmest) > most:
            del calmest[0]
        assert chosen == sorted(calmest, key=lambda s: s.number)
    assert len(set(dropped)) == len(dropped), "given back twice"
    assert not set(dropped) & set(chosen)
    remaining = {*kept.last, *kept.best, *(s for _, _, s in kept.lively)}
    assert remaining | set(dropped) == set(every[:-1])
    assert kept.stored == sum(s.rows for s in remaining)
    assert kept.chosen(every[-1]) == chosen, "a look changes nothing"


@pytest.mark.parametrize("share", [0.02, 0.995])
def test_any_number_of_stretches_finds_room_and_short_ones_take_little(share: float) -> None:
    """Two percent of the rows in each stretch, or nearly all: none is lost, shelf or not."""
    rng = np.random.default_rng(4)
    n = 60 * STRETCH
    there = np.flatnonzero(rng.random(n) < share)
    u = np.cumsum(rng.normal(0.0, 0.004, n))[there]
    blocks = BlockMeans(1, 10 * n)
    blocks.update(there, u, u, u, np.zeros(len(there), np.uint8))
    at, means = blocks.rows()
    np.testing.assert_array_equal(means[np.isin(at, there), 1], u)
    assert blocks.count == len(at) - 1  # the last block is open
    shelves = blocks._means.shape[0]
    assert shelves == SHELVES if share < WHOLE else shelves >= 60 + AT_ONCE


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.sampled_from((1, 2, 5)), st.lists(st.integers(0, 6000), max_size=6))
def test_the_same_bytes_wherever_the_record_is_cut(seed: int, size: int, cuts: list[int]) -> None:
    """With holes, samples that may not be used, and a look at the rows in between."""
    rng = np.random.default_rng(seed)
    n = 6000
    index = np.cumsum(np.where(rng.random(n) < 0.002, rng.integers(1, 30, n), 1))
    u, y = np.cumsum(rng.normal(0.0, 0.004, n)), rng.normal(size=n)
    state = np.where(rng.random(n) < 0.01, 4, 0).astype(np.uint8)
    u[rng.random(n) < 0.002] = np.nan
    whole, cut = BlockMeans(size, 500), BlockMeans(size, 500)
    whole.update(index, y, y, u, state)
    for part in np.split(np.arange(n), sorted(cuts)):
        cut.update(index[part], y[part], y[part], u[part], state[part])
        cut.rows()
    for one, other in zip(whole.rows(), cut.rows(), strict=True):
        assert one.tobytes() == other.tobytes()
    assert (whole.count, whole.range) == (cut.count, cut.range)
