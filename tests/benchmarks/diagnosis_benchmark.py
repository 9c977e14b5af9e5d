"""What oscillations are taken for: python -m tests.benchmarks.diagnosis_benchmark [loops of each cause] [first seed].

Loops that oscillate for a known reason (see cycling_loops), drawn at random and played by the project's simulator;
prints what `diagnose` says of them, cause by cause, and how many statements are right, left open, and wrong.
"""

from __future__ import annotations

import sys
from collections import Counter

from backlash_cli.estimator.diagnosis import diagnose

from .cycling_loops import CAUSES, draw

RIGHT = {
    "stick": {"stiction"}, "stick and gap": {"stiction"}, "gap, tight": {"stiction", "aggressive_tuning"},
    "level, gap": {"backlash_integrating"}, "level, stick": {"backlash_integrating", "stiction"},
    "sine": {"external"}, "square": {"external"}, "sawtooth": {"external"},
    "setpoint": {"setpoint"}, "tight": {"aggressive_tuning"},
}
OPEN = {"none", "unclear"}
KINDS = ("none", "stiction", "backlash_integrating", "tight_nonlinear", "aggressive_tuning", "external", "setpoint",
         "unclear")


def judged(cause: str, kind: str) -> str:
    """Return "right", "open" or "wrong" for what was said of a cause."""
    return "right" if kind in RIGHT[cause] else "open" if kind in OPEN else "wrong"


def main(loops: int = 60, first: int = 0) -> None:
    """Diagnose `loops` loops of each cause and print the table."""
    print(f"{'cause':16s}" + "".join(f"{kind[:14]:>15s}" for kind in KINDS) + f"{'right':>8s}{'open':>7s}{'wrong':>7s}")
    total: Counter[str] = Counter()
    for cause in CAUSES:
        kinds = Counter(diagnose(draw(seed, cause).record).kind for seed in range(first, first + loops))
        result = Counter({say: sum(n for k, n in kinds.items() if judged(cause, k) == say) for say in RESULTS})
        total += result
        print(f"{cause:16s}" + "".join(f"{kinds[kind]:15d}" for kind in KINDS)
              + f"{result['right']:8d}{result['open']:7d}{result['wrong']:7d}", flush=True)
    said = total["right"] + total["wrong"]
    print(f"right {total['right']}, open {total['open']}, wrong {total['wrong']} of {loops * len(CAUSES)}; "
          f"of {said} statements {total['wrong'] / max(said, 1):.1%} wrong")


RESULTS = ("right", "open", "wrong")

if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:]))
