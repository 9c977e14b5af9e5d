"""Frozen results: all that a reporter ever sees."""

from .explain import (
    Candidate,
    Comparison,
    Explanation,
    Fitness,
    FittedEffect,
    FittedParameter,
    Judged,
    Model,
    ModelEffect,
    PlantExplanation,
    Region,
    Rest,
    Series,
    Step,
)
from .scan import (
    NOTHING_SAID,
    UNDECIDED,
    Cluster,
    Compensator,
    Confirmation,
    Estimate,
    Estimates,
    LoopReport,
    PlantResult,
    ScanResult,
    Verdict,
)

__all__ = ["NOTHING_SAID", "UNDECIDED", "Candidate", "Cluster", "Comparison", "Compensator", "Confirmation",
           "Estimate", "Estimates", "Explanation", "Fitness", "FittedEffect", "FittedParameter", "Judged",
           "LoopReport", "Model", "ModelEffect", "PlantExplanation", "PlantResult", "Region", "Rest", "ScanResult",
           "Series", "Step", "Verdict"]
