"""Frozen results: all that a reporter ever sees."""

from .explain import Comparison, Explanation, PlantExplanation, Region, Rest, Series, Step
from .fitted import Candidate, Fitness, FittedEffect, FittedParameter, Model, ModelEffect, gap_size
from .scan import (
    NOTHING_SAID,
    UNDECIDED,
    Cluster,
    Compensator,
    Confirmation,
    Estimate,
    Estimates,
    LoopReport,
    ScanResult,
    Verdict,
)

__all__ = ["NOTHING_SAID", "UNDECIDED", "Candidate", "Cluster", "Comparison", "Compensator", "Confirmation",
           "Estimate", "Estimates", "Explanation", "Fitness", "FittedEffect", "FittedParameter", "LoopReport", "Model",
           "ModelEffect", "PlantExplanation", "Region", "Rest", "ScanResult", "Series", "Step", "Verdict", "gap_size"]
