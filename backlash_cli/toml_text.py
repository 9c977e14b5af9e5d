"""TOML that people write (settings, models, scenarios, limits, the nightly job): read in one way, wrong in one way."""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path
from typing import Any

from .errors import MetadataError


def read_page(path: str | os.PathLike[str], what: str, remedy: str) -> str:
    """Return the text of a page. Raises MetadataError with `what` it is and the `remedy`."""
    try:
        return Path(path).read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise MetadataError(f"cannot read {what}: {getattr(error, 'strerror', None) or 'not UTF-8 text'}",
                            where=str(path), remedy=remedy) from None


def parsed(text: str, where: str, wrong: str = "invalid TOML syntax") -> dict[str, Any]:
    """Return TOML text as plain values. Raises MetadataError naming the line; wrong: how its message begins."""
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError as error:
        line = re.search(r"\(at line (\d+)", str(error))
        raise MetadataError(f"{wrong}: {error}", where=f"{where}, line {line[1]}" if line else where,
                            remedy="mend that line (text in quotes, every bracket closed, every key once)") from None
    except (RecursionError, ValueError, OverflowError):
        raise MetadataError("invalid TOML: nested too deeply or a number too long", where=where) from None
