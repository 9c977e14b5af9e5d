"""The columns of a run share one temporary file, whichever process reads them."""

import gc
import os
import pickle
import resource

import numpy as np
import pytest

from backlash_cli.errors import BacklashError
from backlash_cli.loaders import read, temporary
from backlash_cli.loaders.lazy_tables import Lazily
from backlash_cli.loaders.store import ColumnStore, Room, on_disk
from backlash_cli.loaders.temporary import TemporaryData
from tests.loaders.test_lazy import assert_same, read_lazily


def open_files():
    return len(os.listdir("/proc/self/fd"))


def test_stores_of_one_room_give_back_what_is_theirs():
    room = Room(100)
    random = np.random.default_rng(1)
    pieces = [[random.standard_normal((2, n)) for n in (3, 5, 1)] for _ in range(4)]
    stores = [ColumnStore(room) for _ in pieces]
    for k in range(3):
        for store, own in zip(stores, pieces, strict=True):
            store.add(own[k])
    for store, own in zip(stores, pieces, strict=True):
        whole = np.concatenate(own, axis=1)
        for found in (store, pickle.loads(pickle.dumps(store))):
            np.testing.assert_array_equal([found.column(0), found.column(1)], whole)
            np.testing.assert_array_equal(found.part(1, 1, 2, 3), own[1][1, 2:])
            assert not len(found.part(1, 1, 5))


@pytest.mark.skipif(not os.path.exists("/proc/self/fd"), reason="needs /proc")
def test_one_file_is_open_for_all_stores_and_goes_with_the_last():
    before = open_files()
    room = Room(0)
    stores = [ColumnStore(room) for _ in range(20)]
    for store in stores:
        store.add(np.ones((1, 4)))
    assert open_files() == before + 1
    sent = [pickle.loads(pickle.dumps(store)) for store in stores]
    assert all(store.column(0).sum() == 4.0 for store in sent)
    assert open_files() == before + 2
    del room, store, stores, sent
    gc.collect()
    assert open_files() == before
    first, second = ColumnStore(on_disk()), ColumnStore(on_disk())
    first.add(np.ones((1, 4)))
    second.add(np.zeros((1, 4)))
    assert open_files() == before + 1 and first.column(0).sum() == 4.0
    del first, second
    gc.collect()
    assert open_files() == before


def test_a_folder_of_more_files_than_may_be_open_is_read(tmp_path):
    stamps = np.datetime_as_string(np.datetime64("2026-03-17T08:00:00", "s") + np.arange(30))
    for k in range(80):
        rows = "".join(f"{t},0.5,{(k + i) % 7 / 10},{i % 5 / 10}\n" for i, t in enumerate(stamps.tolist()))
        (tmp_path / f"L{k}.csv").write_text(f"time,L{k}.SP,L{k}.PV,L{k}.OP\n{rows}")
    whole = read(tmp_path)
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (open_files() + 30, limits[1]))
    try:
        lazy = read_lazily(tmp_path, None, Lazily(room=Room(0)))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert_same(whole, lazy)


def test_a_full_or_shortened_file_is_one_message(monkeypatch):
    store = ColumnStore(Room(0))
    store.add(np.ones((1, 4)))
    os.truncate(store._beyond._opened().fileno(), 8)
    with pytest.raises(BacklashError, match="cut short"):
        store.column(0)

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(temporary.tempfile, "mkstemp", full)
    with pytest.raises(BacklashError, match="No space left"):
        TemporaryData().write(memoryview(b"x"))
