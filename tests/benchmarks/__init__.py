"""Benchmarks: each module is run by itself, `python -m tests.benchmarks.NAME`."""

import os

# as the program itself does: threads of the linear algebra that wait for work would be counted as time
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
