"""Settings of control loops as users write them: TOML pages, CSV tables, PID forms of every kind."""

from .csv_table import parse_table
from .loop_settings import Settings, settings_of
from .schema import LOOP_KEYS, ROLE_KEYS, LoopValues, Metadata, merge
from .toml_page import parse_toml

__all__ = ["LOOP_KEYS", "ROLE_KEYS", "LoopValues", "Metadata", "Settings", "merge", "parse_table", "parse_toml",
           "settings_of"]
