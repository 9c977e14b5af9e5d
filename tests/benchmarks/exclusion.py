"""Fit the chance that a dead band hides, as `backlash_cli/estimator/width_profile.py` has it, on strangers' plants.

    python -m tests.benchmarks.exclusion 1000 --seed 90000
"""

import argparse
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import statsmodels.api as sm

from backlash_cli import read
from backlash_cli.estimator.confirm import Study, confirm, study
from backlash_cli.estimator.width_profile import LIMITS, signs
from backlash_cli.results import Confirmation
from backlash_cli.scanning import COARSEST

from .strangers import write


def table(folder: str | Path) -> pd.DataFrame:
    """Signs of every limit of every loop without a trace in the exports of `write`, and whether such a gap is there."""
    truth = pd.read_csv(Path(folder) / "truth.csv", keep_default_na=False).set_index("name")
    rows = []
    for file in sorted(Path(folder).glob("f*.csv.gz")):
        for record in read(file, loops=str(file).replace(".csv.gz", ".loops.toml")):
            true = truth.loc[record.loop]
            found, asked = confirm(record), study(record, record.settings)
            if true.truth == "stick" or not isinstance(found, Confirmation) or found.details["trace"]:
                continue
            assert isinstance(asked, Study)
            if asked.interval > COARSEST * asked.Ti:  # a verdict clears none of them
                continue
            evidence = float(found.details["evidence"])
            seen = signs([a.test for a in asked.asked], evidence, asked.length, asked.moved)[:, :-1]
            rows += [[true.d >= L, *of] for L, of in zip(LIMITS, seen, strict=True)]
    columns = ["there", "gain", "above the mean", "evidence", "length", "span over limit"]
    return pd.DataFrame(rows, columns=columns)


def main() -> None:
    """Print weights and constant."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("loops", type=int)
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        write(folder, range(chosen.seed, chosen.seed + chosen.loops))
        data = table(folder)
    fitted = sm.Logit(data.there.astype(float), sm.add_constant(data.drop(columns="there"))).fit(disp=False)
    print(fitted.summary())
    print("WEIGHTS, CONSTANT =", tuple(np.round(fitted.params[1:], 3)), round(fitted.params.iloc[0], 3))


if __name__ == "__main__":
    main()
