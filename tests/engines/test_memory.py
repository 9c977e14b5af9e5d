"""Memory of a scan does not follow the length of the file: only one loop is in memory at a time.

The short file is scanned twice: what the first scan of a process takes by chance is no part of the difference.
"""

import pytest

from tests.benchmarks.made_plant import write, write_long, write_rough
from tests.benchmarks.memory import peaks_of


def test_a_file_three_times_as_long_takes_hardly_more_memory(tmp_path):
    short = write(tmp_path / "short.csv", loops=120, days=0.25, kinds=1)
    long = write(tmp_path / "long.csv", loops=120, days=0.75, kinds=1)
    room = 1 << 20
    more = (long.stat().st_size - short.stat().st_size) / (1 << 20)
    for _ in range(3):  # two peaks of one scan differ by up to 40 MB, now and then
        (loops, before, _), (same, after, _) = peaks_of(short, short, long, room=room)[1:]
        assert loops == same == 120 and more > 80.0
        if after - before < 0.3 * more:  # kept whole, it would be three times the difference, each time
            return
    pytest.fail(f"{after - before:.0f} MB more for {more:.0f} MB more of text")


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_long_file_four_times_as_long_takes_hardly_more_memory(tmp_path, suffix):
    paths = (write_long(tmp_path / f"{days}_days.{suffix}", 12, days, kinds=1) for days in (0.5, 2.0))
    (_, before, _), (_, after, _) = peaks_of(*paths, room=1 << 20)
    assert after - before < 100.0  # [MB]; kept whole, its 4.5 million rows more would take 750


def test_a_rough_record_four_times_as_long_takes_hardly_more_memory(tmp_path):
    """From two million rows on it is made in chunks; here in eighths of that, for shorter files."""
    short, long = (write_rough(tmp_path / f"{days}_days.csv", days) for days in (6.0, 26.0))
    (_, before, _), (_, after, _) = peaks_of(short, short, long, room=1 << 20, chunk=250_000)[1:]
    assert after - before < 150.0  # [MB], and peaks vary by 50; kept whole (chunk=1 << 40) it is 340
