"""Memory that arrays gave back stays with the process, for the next arrays of the same size."""

from __future__ import annotations

import ctypes
import sys
from functools import cache

KEPT = 64 << 20  # bytes at the end of the heap that are not given back to the system
LARGEST = 32 << 20  # bytes of an array that comes from the heap; the system allows no more
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # numbers of glibc's mallopt


@cache
def keep_freed_memory() -> bool:
    """Ask glibc not to give the memory of each freed array back, and say whether it does so.

    Otherwise each array of a loop is fetched anew from the system, which clears it page by page: that took a third of
    the time of a scan.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        library = ctypes.CDLL(None)
        return bool(library.mallopt(_MMAP_THRESHOLD, LARGEST) and library.mallopt(_TRIM_THRESHOLD, KEPT))
    except (OSError, AttributeError):  # another C library
        return False
