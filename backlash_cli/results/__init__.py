"""Frozen results: all that a reporter ever sees."""

from .scan import Cluster, Compensator, Confirmation, Estimate, LoopReport, ScanResult, Verdict

__all__ = ["Cluster", "Compensator", "Confirmation", "Estimate", "LoopReport", "ScanResult", "Verdict"]
