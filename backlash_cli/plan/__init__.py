"""From "cannot tell" to a test plan: the least that would decide a loop, by simulating this loop.

`twin` makes a simulated loop out of a record and plays on it what can be done to tell, `search` finds the least that
tells a valve with a dead band of the target's size from a healthy one. The judge is the scan itself."""

from .search import PlanOptions, plan
from .twin import KINDS, Move

__all__ = ["KINDS", "Move", "PlanOptions", "plan"]
