"""Loaders: historian exports and loop settings to Records."""

from .options import ReadOptions
from .plant import Plant, read

__all__ = ["Plant", "ReadOptions", "read"]
