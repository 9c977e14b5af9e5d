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
    from .model.compare import compare
    from .model.explain import explain
    from .record import LoopSettings, Note, Record, record_from_arrays
    from .reporter.json_report import to_json
    from .reporter.tables import to_dataframe
    from .results import Comparison, Explanation, LoopReport, Model, ScanResult, Verdict
    from .scanning import ScanOptions

_HOMES = {name: home for home, names in {
    "loaders": "read ReadOptions",
    "api": "scan scan_files load_model save_model",
    "scanning": "ScanOptions",
    "model": "compare explain",
    "results": "Comparison Explanation Model LoopReport ScanResult Verdict",
    "reporter.tables": "to_dataframe",
    "reporter.json_report": "to_json",
    "record": "Record LoopSettings Note record_from_arrays",
    "errors": "BacklashError",
}.items() for name in names.split()}

__all__ = ["BacklashError", "Comparison", "Explanation", "LoopReport", "LoopSettings", "Model", "Note", "ReadOptions",
           "Record", "ScanOptions", "ScanResult", "Verdict", "__version__", "compare", "explain", "load_model", "read",
           "record_from_arrays", "save_model", "scan", "scan_files", "to_dataframe", "to_json"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
