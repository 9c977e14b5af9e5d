"""What is known once never changes, and arrays are not compared where nobody asked for it."""

import pickle
from dataclasses import FrozenInstanceError, field, replace

import numpy as np
import pytest

from backlash_cli.record import FloatArray, Frozen, LoopSettings, record_from_arrays


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


@pytest.mark.parametrize(("change", "words"), [
    ({"interval": 0.0}, "interval 0"), ({"interval": float("nan")}, "interval nan"),
    ({"output": np.zeros(8)}, "output has"), ({"measurement": np.full((9, 2), 0.4)}, "2 dimensions"),
    ({"settings": LoopSettings(Kp=0.0)}, "Kp 0"), ({"settings": LoopSettings(Td=-1.0)}, "Td -1"),
    ({"settings": LoopSettings(K=float("nan"))}, "K nan"),
    ({"settings": LoopSettings(K=0.0)}, "K 0"), ({"settings": LoopSettings(K=1.0, Ti=-3.0)}, "Ti -3")])
def test_arrays_that_make_no_record_are_refused(change, words):
    with pytest.raises(ValueError, match=words):
        record_from_arrays(0.5, **{"measurement": np.full(9, 0.4), "output": None, "interval": 1.0, **change})


def test_arrays_in_engineering_units_are_noted():
    record = record_from_arrays(58.0, np.full(9, 58.0), np.full(9, 0.4), interval=1.0)
    assert [note.code for note in record.notes] == ["not_in_spans"] and "measurement is 58" in record.notes[0].message
