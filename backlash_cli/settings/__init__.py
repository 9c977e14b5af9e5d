"""Settings of control loops as users write them: TOML pages, CSV tables, PID forms of every kind."""

from .schema import ROLE_KEYS, LoopValues, Metadata, Settings, merge, parse_table, parse_toml, settings_of

__all__ = ["ROLE_KEYS", "LoopValues", "Metadata", "Settings", "merge", "parse_table", "parse_toml", "settings_of"]
