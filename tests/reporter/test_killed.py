"""A process killed while it writes reports leaves the previous or the new content, never a mixture."""

import random
import re
from pathlib import Path

from backlash_cli.reporter.scan_report import write
from tests.killed_writers import TELL, killed
from tests.reporter.reports import report, result

FORMS = ("json", "csv", "parquet", "html", "table")
LOOPS = 12
RUNS = [result(*(report(f"L{i}", d) for i in range(LOOPS))) for d in (0.01, 0.03)]


def write_all(folder: Path, k: int, name: str = "r") -> None:
    """Write the reports of one of RUNS in every form."""
    for form in FORMS:
        write(RUNS[k], {}, form, folder / f"{name}.{form}")
    write(RUNS[k], {}, "html", folder / "pages")


BEGIN = """
from pathlib import Path
from tests.reporter.test_killed import write_all
folder = Path(sys.argv[1])
"""
WORK = f"write_all(folder, 1)\n{TELL}while True:\n    write_all(folder, 0), write_all(folder, 1)\n"


def kill_while_writing(folder: Path, times: int, seed: int = 0) -> int:
    """Kill a writing process `times` times at random moments and check every report; returns the reports checked."""
    whole = folder / "whole"
    whole.mkdir()
    for k in (0, 1):
        write_all(whole, k, str(k))
    good = {form: [(whole / f"{k}.{form}").read_bytes() for k in (0, 1)] for form in FORMS}
    chance, checked = random.Random(seed), 0
    for _ in killed(BEGIN, WORK, folder, (chance.uniform(0.0, 0.3) for _ in range(times))):
        for form in FORMS:
            path = folder / f"r.{form}"
            if path.exists():
                assert path.read_bytes() in good[form], f"{form}: neither the old nor the new report"
                checked += 1
        if (folder / "pages" / "index.html").exists():
            check_folder(folder / "pages")
            checked += 1
    return checked


def check_folder(folder: Path) -> None:
    """Every link of the index leads to a whole page of the same run."""
    index = (folder / "index.html").read_text("utf-8")
    links = re.findall(r'href="(loops-[^"]+)"', index)
    size = re.search(r">(\d\.\d\d)<", index)
    assert len(links) == LOOPS and len({link.split("/")[0] for link in links}) == 1 and size
    for link in links:
        page = (folder / link).read_text("utf-8")
        assert page.rstrip().endswith("</html>") and f"{size.group(1)} % of the output span" in page


def test_killed_at_random_moments(tmp_path):
    assert kill_while_writing(tmp_path, 4) == 4 * (len(FORMS) + 1)
