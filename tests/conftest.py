"""What tests of several folders share."""

import signal

import pytest

from tests.reporter.chromium import Browser

signal.signal(signal.SIGINT, signal.default_int_handler)  # a run in the background ignores it, and all it begins


@pytest.fixture(scope="module")
def browser():
    started = Browser()
    yield started
    started.close()
