"""Kill a process 200 times at random moments while it writes every kind of report; each report stays whole.

    python -m tests.benchmarks.kill_reports
"""

import tempfile
from pathlib import Path

from tests.reporter.test_killed import kill_while_writing


def main(times: int = 200) -> None:
    """Print how many reports were found whole; fails at the first that is not."""
    with tempfile.TemporaryDirectory() as folder:
        checked = kill_while_writing(Path(folder), times, seed=1)
    print(f"{times} kills, {checked} reports checked, each of them the previous or the new one")


if __name__ == "__main__":
    main()
