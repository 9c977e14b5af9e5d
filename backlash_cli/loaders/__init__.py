"""Loaders: historian exports to Records."""

from .options import ReadOptions
from .plant import Plant, read

__all__ = ["Plant", "ReadOptions", "read"]
