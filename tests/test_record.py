"""What is known once never changes, and arrays are not compared where nobody asked for it."""

import pickle
from dataclasses import FrozenInstanceError, field, replace

import numpy as np
import pytest

from backlash_cli.record import FloatArray, Frozen


class Size(Frozen):
    d: float
    notes: tuple[str, ...] = field(default=(), repr=False)


class Samples(Frozen, eq=False):
    values: FloatArray


def test_frozen_values_compare_and_cannot_be_changed():
    one = Size(0.02)
    assert one == Size(0.02) != Size(0.03) and len({one, Size(0.02)}) == 1
    assert replace(one, d=0.03) == Size(0.03) and pickle.loads(pickle.dumps(one)) == one
    assert repr(one).endswith("Size(d=0.02)")
    with pytest.raises(FrozenInstanceError):
        one.d = 0.03


def test_what_holds_arrays_is_only_equal_to_itself():
    one, other = Samples(np.zeros(2)), Samples(np.zeros(2))
    assert one == one != other and len({one, other}) == 2
