"""Where the reference data beside the project are found; tests that use them skip with a reason without them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def shared_root() -> Path:
    """Folder `shared` beside the checkout, or the one named by BACKLASH_SHARED."""
    given = os.environ.get("BACKLASH_SHARED")
    return Path(given) if given else Path(__file__).resolve().parents[2] / "shared"


def shared_data(*parts: str) -> Path:
    """Return the path of reference data below `shared/data`, or skip the calling test."""
    path = shared_root().joinpath("data", *parts)
    if not path.exists():
        pytest.skip(f"reference data {'/'.join(parts)} are not beside this checkout (set BACKLASH_SHARED)")
    return path
