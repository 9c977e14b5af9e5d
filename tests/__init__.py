"""Tests of backlash."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program itself: threads of two workers would wait for
os.environ.setdefault("OMP_NUM_THREADS", "1")  # each other, and sum in another order. Before NumPy is imported
