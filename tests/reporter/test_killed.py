"""A process killed while it writes reports leaves the previous or the new content, never a mixture."""

import random
import re
import signal
import subprocess
import sys
from pathlib import Path

FORMS = ("json", "csv", "parquet", "html", "table")
LOOPS = 12

WRITER = f"FORMS, LOOPS = {FORMS!r}, {LOOPS}" + """
import sys
from pathlib import Path
from backlash_cli.reporter.scan_report import write
from tests.reporter.reports import record, report, result
runs = [result(*(report(f"L{i}", d) for i in range(LOOPS))) for d in (0.01, 0.03)]
folder, once = Path(sys.argv[1]), len(sys.argv) > 2
def write_all(k, name):
    for form in FORMS:
        write(runs[k], {}, form, folder / f"{name}.{form}")
    write(runs[k], {}, "html", folder / "pages")
if once:
    write_all(0, 0), write_all(1, 1)
else:
    write_all(1, "r")
print("ready", flush=True)
while not once:
    write_all(0, "r"), write_all(1, "r")
"""


def start(folder: Path, *more: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", WRITER, str(folder), *more]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert running.stdout is not None and running.stdout.readline() == b"ready\n"
    return running


def kill_while_writing(folder: Path, times: int, seed: int = 0) -> int:
    """Kill a writing process `times` times at random moments and check every report; returns the reports checked."""
    whole = folder / "whole"
    whole.mkdir()
    start(whole, "once").wait()
    good = {form: [(whole / f"{k}.{form}").read_bytes() for k in (0, 1)] for form in FORMS}
    chance, checked = random.Random(seed), 0
    for _ in range(times):
        running = start(folder)
        try:
            running.wait(chance.uniform(0.0, 0.3))
        except subprocess.TimeoutExpired:
            running.send_signal(signal.SIGKILL)
        running.communicate()
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
