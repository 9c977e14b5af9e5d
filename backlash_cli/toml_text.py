"""TOML that people write (settings, models, scenarios, limits, the nightly job): read in one way, wrong in one way."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from .errors import MetadataError


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
