"""One cluster of two worker processes for the tests of this folder: starting it takes seconds."""

import os
import time

import pytest

from backlash_cli.engines.cluster import connected
from backlash_cli.engines.local import context_of_processes


@pytest.fixture(scope="session")
def client():
    """The cluster's client; when the tests are over no process of it may be left."""
    with connected(None, 2, method=context_of_processes().get_start_method()) as found:
        yield found
        processes = processes_below()
    until = time.monotonic() + 10.0
    while (left := processes & processes_below()) and time.monotonic() < until:
        time.sleep(0.05)
    assert not left, f"processes of the cluster are still there: {left}"


def processes_below(first=None):
    """Numbers of the living processes that this one started, and that those started; where the system tells."""
    first = os.getpid() if first is None else first
    found = set()
    for thread in _listed(f"/proc/{first}/task"):
        try:
            with open(f"/proc/{first}/task/{thread}/children") as file:
                children = [int(word) for word in file.read().split()]
        except OSError:
            continue
        for child in children:
            if _lives(child):
                found |= {child} | processes_below(child)
    return found


def _listed(folder):
    try:
        return os.listdir(folder)
    except OSError:
        return []


def _lives(number):
    try:
        with open(f"/proc/{number}/stat") as file, open(f"/proc/{number}/cmdline") as command:
            ended = file.read().rpartition(")")[2].split()[0] == "Z"
            own = command.read()  # Python's own processes are there for the whole run
            return not ended and "resource_tracker" not in own and "forkserver" not in own
    except OSError:
        return False
