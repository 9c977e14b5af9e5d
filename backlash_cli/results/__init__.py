"""Frozen results: all that a reporter ever sees. Fields without a `repr` are for figures; reports do not list them."""

from .explain import *  # noqa: F403
from .scan import *  # noqa: F403
