"""What tests of several folders share."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program itself: threads of two workers would wait for
os.environ.setdefault("OMP_NUM_THREADS", "1")  # each other. Before NumPy is imported

import pytest

from tests.reporter.chromium import Browser


@pytest.fixture(scope="module")
def browser():
    started = Browser()
    yield started
    started.close()
