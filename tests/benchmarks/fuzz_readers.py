"""Mutated exports and loop settings: nothing but the project's own errors may leave `read`.

    python -m tests.benchmarks.fuzz_readers --seconds 60 [--seed 1] [--keep FOLDER]

Small valid files are flipped, cut, doubled, spliced and sprinkled with hostile tokens. An input counts as broken when
another exception leaves `read`, when it takes longer than 10 s, or when a record is not what the Record promises.
Broken inputs are written to --keep. Ends with status 1 when there were any.
"""

from __future__ import annotations

import argparse
import gzip
import io
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from backlash_cli.errors import BacklashError
from backlash_cli.loaders import Plant, ReadOptions, read
from tests.loaders.exports import SETTINGS
from tests.loaders.test_layouts import EXPORTS

SLOW = 10.0
TOKENS = [
    b"", b",", b";", b"\t", b'"', b'""', b"\n", b"\r", b"\r\n", b"\x00", b"\xff", b"\xfe\xff", b"\xef\xbb\xbf",
    b"nan", b"inf", b"-inf",     b"1e308", b"-1e309", b"1e-320", b"99999999999999999999", b"-1", b"0",
    b"1970-01-01T00:00:00", b"9999-12-31T23:59:59", b"0000-00-00",     b"2026-02-30 25:61:61", b"31/12/9999",
    b"Bad", b"MAN", b"Good", b"%s%n", b"=1+1", b"../..", b"[loops.X]", b"[[", b"]", b"= ",
    b"Ti = 0",     b"K = nan", b"pv_range = []", b"{}", b"'", b"\\", b"\xc3\x28", b"A" * 3000, b"1," * 500,
    b"PAR1", b"\x1f\x8b", b"#", b"sep=;\n",     b"timestamp", b"FIC101.PV", b"value", b"Infinity", b"+1e5",
    b"1.#QNAN", b"12:00:00 AM", b"24:00:00", b"+99:99", b"UTC", b"BC",
]  # fmt: skip


def seeds() -> list[tuple[str, bytes]]:
    """Small valid files of every kind, cut to some 60 lines so that mutations meet all of their parts."""
    found = []
    for key, export in EXPORTS.items():
        name, content = next(iter(export.files.items()))
        if isinstance(content, pa.Table):
            for compression in ("snappy", "none"):
                buffer = io.BytesIO()
                pq.write_table(content.slice(0, 80), buffer, compression=compression)
                found.append((f"{key}.parquet", buffer.getvalue()))
        elif isinstance(content, str):
            lines = content.splitlines(keepends=True)
            found.append((f"{key}.csv", "".join(lines[:60]).encode()))
            if key in ("time_iso", "long_time_order", "pairs"):
                found.append((f"{key}.csv.gz", gzip.compress("".join(lines[:200]).encode())))
        else:
            found.append((key + Path(name).suffix, content[:8000]))
    return found


def mutate(data: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    """Change a few things anywhere in the bytes."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        size = len(out)
        at = int(rng.integers(0, size + 1))
        length = int(rng.choice([1, 2, 4, 8, 64, 512]))
        match int(rng.integers(0, 8)):
            case 0 if size:
                out[at % size] ^= 1 << int(rng.integers(0, 8))
            case 1:
                del out[at : at + length]
            case 2:
                out[at:at] = out[at : at + length]
            case 3:
                out[at:at] = TOKENS[int(rng.integers(0, len(TOKENS)))]
            case 4:
                token = TOKENS[int(rng.integers(0, len(TOKENS)))]
                out[at : at + len(token)] = token
            case 5:
                other = others[int(rng.integers(0, len(others)))]
                start = int(rng.integers(0, len(other) + 1))
                out[at:at] = other[start : start + length * 4]
            case 6:
                del out[at:]
            case 7 if size:
                out[at % size] = int(rng.integers(0, 256))
    return bytes(out)


def broken_promise(plant: Plant) -> str:
    """Return what a Plant does not keep of what Record promises, "" if nothing."""
    for record in plant:
        n = len(record.index)
        arrays = [record.setpoint, record.measurement, record.state]
        arrays += [] if record.output is None else [record.output]
        if any(len(a) != n for a in arrays):
            return "lengths differ"
        if n and np.any(np.diff(record.index) <= 0):
            return "index does not increase"
        if not (np.isfinite(record.interval) and record.interval > 0 and np.isfinite(record.start)):
            return "no interval or start"
        usable = record.usable
        if not np.isfinite(record.measurement[usable]).all():
            return "usable samples that are not finite"
        if not np.isnan(record.setpoint).all() and not np.isfinite(record.setpoint[usable]).all():
            return "usable samples without a setpoint"
        if record.settings.Ti is not None and not record.settings.Ti > 0:
            return "Ti is not positive"
    return ""


def trial(folder: Path, name: str, data: bytes, settings: bytes, options: ReadOptions) -> str:
    """Read one mutated input; returns what was wrong, "" when it was read or refused properly."""
    path = folder / name
    path.write_bytes(data)
    (folder / "loops.toml").write_bytes(settings)
    started = time.monotonic()
    wrong = ""
    try:
        wrong = broken_promise(read(path, options=options))
    except BacklashError as error:
        if not str(error).strip():
            wrong = "an empty message"
    except BaseException as error:
        if isinstance(error, (KeyboardInterrupt, SystemExit)):
            raise
        wrong = f"{type(error).__name__}: {str(error)[:200]}"
    path.unlink()
    took = time.monotonic() - started
    return wrong or (f"took {took:.1f} s" if took > SLOW else "")


def main(arguments: list[str] | None = None) -> int:
    """Run the fuzzer for a given time."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--keep", type=Path, default=None)
    given = parser.parse_args(arguments)
    seed = given.seed if given.seed is not None else int(time.time())
    rng = np.random.default_rng(seed)
    files = seeds()
    texts = [data for name, data in files if not name.endswith((".parquet", ".gz"))]
    toml = SETTINGS.encode()
    choices = [ReadOptions(), ReadOptions(timezone="Europe/Berlin"), ReadOptions(interpolation="hold"),
               ReadOptions(decimal=","), ReadOptions(layout="long"), ReadOptions(time_format="dmy")]  # fmt: skip
    count, faults = 0, 0
    end = time.monotonic() + given.seconds
    with tempfile.TemporaryDirectory() as place:
        while time.monotonic() < end:
            name, data = files[int(rng.integers(0, len(files)))]
            settings = mutate(toml, texts, rng) if rng.random() < 0.15 else toml
            options = choices[int(rng.integers(0, len(choices)))] if rng.random() < 0.2 else choices[0]
            changed = mutate(data, texts, rng)
            wrong = trial(Path(place), name, changed, settings, options)
            count += 1
            if wrong:
                faults += 1
                print(f"{name} #{count}: {wrong} {options if options != choices[0] else ''}", flush=True)
                if given.keep is not None:
                    given.keep.mkdir(parents=True, exist_ok=True)
                    (given.keep / f"{seed}-{count}-{name}").write_bytes(changed)
                    (given.keep / f"{seed}-{count}-{name}.loops.toml").write_bytes(settings)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{count} inputs, {faults} broken, seed {seed}, {memory:.0f} MB at most")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
