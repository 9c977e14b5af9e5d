"""Models of a loop: compare one with the measurements, explain which physical effect it lacks."""

from ..results import Comparison, Explanation, Model
from .compare import compare
from .explain import explain

__all__ = ["Comparison", "Explanation", "Model", "compare", "explain"]
