"""Where the goldens stand: one line per loop, so that a change is one line of a diff."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

READINGS = Path(__file__).with_name("readings.json")
REPORTS = Path(__file__).with_name("reports.json")


def load(path: Path) -> dict[str, Any]:
    """Return a golden, an empty one where there is none yet."""
    return json.loads(path.read_text("utf-8")) if path.exists() else {}


def save(path: Path, found: dict[str, Any]) -> None:
    """Write a golden."""
    lines = []
    for name, value in found.items():
        if "loops" in value:
            loops = ",\n".join(f"  {json.dumps(loop)}: {json.dumps(one)}" for loop, one in value["loops"].items())
            rest = ", ".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in value.items() if k != "loops")
            lines.append(f'{json.dumps(name)}: {{"loops": {{\n{loops}}}, {rest}}}')
        else:
            lines.append(f"{json.dumps(name)}: {json.dumps(value)}")
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
