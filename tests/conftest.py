"""What tests of several folders share."""

import pytest

from tests.reporter.chromium import Browser


@pytest.fixture(scope="module")
def browser():
    started = Browser()
    yield started
    started.close()
