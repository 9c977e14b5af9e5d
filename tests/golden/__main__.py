"""Refresh the goldens, and say what changed."""

from __future__ import annotations

import json
import sys

from .digest import differences, readings, reports
from .store import READINGS, REPORTS, load, save


def main() -> int:
    changed = 0
    for path, make in ((READINGS, readings), (REPORTS, reports)):
        new = json.loads(json.dumps(make()))
        words = list(differences(load(path), new))
        changed += len(words)
        print(f"{path.name}: {len(words)} changes" if words else f"{path.name}: nothing changed")
        for line in words:
            print(f"  {line}")
        if words and "--check" not in sys.argv:
            save(path, new)
    return 1 if changed and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
