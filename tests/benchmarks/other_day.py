"""Does a model kept from one recording hold on other recordings of the same loop, to which it was not fitted?

    python -m tests.benchmarks.other_day FOLDER [--most 3]

FOLDER holds single-loop CSV files named LOOP_DATE_TIME.csv. The model comes from the first recording of each loop;
on the others its numbers are kept and only offset and start are matched (`compare`). Printed per loop: the effects,
and on each other recording the hold-out error of the plain model fitted THERE and of the kept model. Below 1 the kept
model, which has seen nothing of that day, is better than a plain model fitted to that day.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np

from backlash_cli import compare, explain, read
from backlash_cli.errors import BacklashError


def main() -> None:
    """Run the check and print its table."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("folder", type=Path)
    ask.add_argument("--most", type=int, default=3, help="other recordings per loop")
    given = ask.parse_args()
    tags: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(given.folder.glob("*.csv")):
        tags[path.stem.split("_")[0]].append(path)
    ratios, plain_kept = [], []
    for tag, paths in tags.items():
        if len(paths) < 2:
            continue
        try:
            first = explain(next(iter(read(paths[0]))))
        except BacklashError as error:
            print(f"{tag}: {error}")
            continue
        names = " + ".join(e.effect for e in first.effects) or "nothing"
        gone = first.rmse_holdout / first.baseline.rmse_holdout
        print(f"{tag} {paths[0].stem[len(tag) + 1:]}: {names}; there {gone:.2f} of the plain model's error", flush=True)
        for path in paths[1 : 1 + given.most]:
            record = next(iter(read(path)))
            try:
                there = compare(record, first.model)
            except BacklashError as error:
                print(f"   {path.stem[len(tag) + 1:]}: {error}")
                continue
            ratio = there.fitness.rmse_holdout / there.baseline.rmse_holdout
            (ratios if first.effects else plain_kept).append(ratio)
            print(f"   {path.stem[len(tag) + 1:]}: plain {100 * there.baseline.rmse_holdout:.3f} %, kept "
                  f"{100 * there.fitness.rmse_holdout:.3f} %: {ratio:.2f}", flush=True)
    for name, values in (("with effects", ratios), ("nothing added", plain_kept)):
        if values:
            better = sum(v < 1.0 for v in values)
            print(f"{name}: kept model better than a plain one fitted that day on {better} of {len(values)} days, "
                  f"ratio median {np.median(values):.2f}")


if __name__ == "__main__":
    main()
