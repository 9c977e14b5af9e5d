"""What tests of several folders share."""

import signal
from itertools import chain

import pytest

from backlash_cli.engines import local
from tests.remembered import remembered
from tests.reporter.chromium import Browser

signal.signal(signal.SIGINT, signal.default_int_handler)  # a run in the background ignores it, and all it begins


@pytest.fixture(scope="module")
def browser():
    started = Browser()
    yield started
    started.close()


@pytest.fixture(scope="module")
def analysed_once():
    """A loop with the same samples, settings and options is analysed once, however often a module's commands ask.

    For tests of what commands make of reports. What runs in processes of its own is analysed there, each time.
    """
    real = local.analyse_loop
    known = remembered(lambda first, options: real(first, options, iter(())))

    def analysed(first, options, others):
        more = next(others, None)
        return known(first, options) if more is None else real(first, options, chain([more], others))

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(local, "analyse_loop", analysed)
        yield
