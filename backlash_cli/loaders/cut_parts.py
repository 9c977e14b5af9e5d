"""How the loops of a plant are dealt out: parts of about the same work, whose loops lie in the same files."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

from .shares import Part, PlantPlan

PARTS_PER_WORKER = 4  # so that a slow worker holds up the others by a fraction only
SMALLEST = 8 << 20  # bytes of files in a part: below, sending it costs more than it brings
MOST_LOOPS = 50  # of a part: what is lost when a worker dies, and how often the progress moves


def cut_parts(
    plan: PlantPlan, workers: int, loops: Iterable[str] | None = None, most: int | None = None
) -> list[Part]:
    """Return the parts of a plan for so many workers; loops: only these. most: loops of a part.

    Loops of the same files stay together. A Parquet file may be cut into many parts, as each reads its columns only;
    a CSV into no more than there are workers, as each has to go through all of it.
    """
    most = min(most or MOST_LOOPS, MOST_LOOPS)
    wanted = sorted(plan.loops if loops is None else loops)
    cost = _costs(plan)
    total = sum(cost[name] for name in wanted)
    target = max(total / (PARTS_PER_WORKER * max(workers, 1)), SMALLEST)
    groups: dict[tuple[int, ...], list[str]] = {}
    for name in wanted:
        groups.setdefault(plan.loops[name], []).append(name)
    parts: list[list[str]] = []
    small: list[str] = []
    for files, names in sorted(groups.items()):
        work = sum(cost[name] for name in names)
        text = any(plan.surveys[number].text for number in files)
        if len(names) > 1 and (work > target or len(names) > most):
            count = max(round(work / target), -(-len(names) // most))
            parts += _evenly(names, min(count, workers) if text else count)
            continue
        if small and (sum(cost[n] for n in small) + work > target or len(small) + len(names) > most):
            parts.append(small)
            small = []
        small += names
    return [plan.part(names) for names in (*parts, *([small] if small else []))]


def _costs(plan: PlantPlan) -> dict[str, float]:
    """Bytes of files that belong to each loop: a file is shared by the loops in it."""
    loops_in = [0] * len(plan.sources)
    for files in plan.loops.values():
        for number in files:
            loops_in[number] += 1
    return {name: sum(plan.surveys[k].size / loops_in[k] for k in files) for name, files in plan.loops.items()}


def _evenly(names: list[str], count: int) -> list[list[str]]:
    count = max(1, min(count, len(names)))
    edges = [round(k * len(names) / count) for k in range(count + 1)]
    return [names[a:b] for a, b in pairwise(edges)]
