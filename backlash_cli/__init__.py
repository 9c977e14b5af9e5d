"""backlash: find play (dead band) in control valves from historian exports.

    from backlash_cli import read, scan, to_dataframe

    plant = read(["plant.csv"])
    result = scan(plant)
    print(to_dataframe(result))
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._version import __version__

if TYPE_CHECKING:
    from .api import load_model, save_model, scan, scan_files
    from .errors import BacklashError
    from .loaders import ReadOptions, read
    from .model import compare, explain
    from .record import LoopSettings, Note, Record, record_from_arrays
    from .reporter.json_report import to_json
    from .reporter.tables import to_dataframe
    from .results import Comparison, Explanation, LoopReport, Model, ScanResult, Verdict
    from .scanning import ScanOptions

_HOMES = {
    "read": "loaders",
    "ReadOptions": "loaders",
    "scan": "api",
    "scan_files": "api",
    "ScanOptions": "scanning",
    "compare": "model",
    "explain": "model",
    "load_model": "api",
    "save_model": "api",
    "Comparison": "results",
    "Explanation": "results",
    "Model": "results",
    "to_dataframe": "reporter.tables",
    "to_json": "reporter.json_report",
    "Record": "record",
    "LoopSettings": "record",
    "Note": "record",
    "record_from_arrays": "record",
    "LoopReport": "results",
    "ScanResult": "results",
    "Verdict": "results",
    "BacklashError": "errors",
}

__all__ = [
    "BacklashError",
    "Comparison",
    "Explanation",
    "LoopReport",
    "LoopSettings",
    "Model",
    "Note",
    "ReadOptions",
    "Record",
    "ScanOptions",
    "ScanResult",
    "Verdict",
    "__version__",
    "compare",
    "explain",
    "load_model",
    "read",
    "record_from_arrays",
    "save_model",
    "scan",
    "scan_files",
    "to_dataframe",
    "to_json",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
