"""Settings of control loops as users write them: TOML pages, CSV tables, PID forms of every kind."""

from .pages import parse_table, parse_toml
from .schema import LOOP_KEYS, ROLE_KEYS, LoopValues, Metadata, Settings, merge, settings_of

__all__ = ["LOOP_KEYS", "ROLE_KEYS", "LoopValues", "Metadata", "Settings", "merge", "parse_table", "parse_toml",
           "settings_of"]
