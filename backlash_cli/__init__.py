"""backlash: find play (dead band) in control valves from historian exports."""

from ._version import __version__

__all__ = ["__version__"]
