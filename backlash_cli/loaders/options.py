"""What a user may say about an export when the file itself does not say it clearly."""

from zoneinfo import ZoneInfo, available_timezones

from ..errors import UsageError, nearest
from ..record import Frozen
from ..selection import check_pattern, parse_since, sample_size
from .names import WORDS, explained

DELIMITERS = (",", ";", "\t", "|", "^", " ")  # that are looked for
TIME_WORDS = ("iso", "ymd", "dmy", "mdy", *WORDS["stamps"]["unit"])


class ReadOptions(Frozen):
    """How to read exports; every `None` means: find it in the file. time_format: strptime pattern or one of TIME_WORDS.
    timezone: IANA name of the zone of stamps without offset. interpolation: "hold" or "linear" for every signal; None:
    measurement linear, the rest hold. delimiter, decimal, encoding: of CSV files ("," "tab" ..., "." or ",", "cp1252"
    ...). layout: "wide", "tall", "long" or "pairs". columns: names of the columns of a file without a header line.
    header_row: number (from 1) of the line that names them. only_loops: names or wildcards, each of which must exist.
    loops_matching: patterns (`check_pattern`) of which one must fit. sample: "20" or "5%" of those left, drawn by
    sample_seed. since: a moment or an age (`parse_since`). good_quality, auto_modes: further words or numbers that mean
    good, or automatic. max_bytes: of a file in memory. tags: those that the settings name, in lower case."""

    time_format: str | None = None
    timezone: str | None = None
    interpolation: str | None = None
    delimiter: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    layout: str | None = None
    columns: tuple[str, ...] = ()
    header_row: int | None = None
    only_loops: tuple[str, ...] = ()
    loops_matching: tuple[str, ...] = ()
    sample: str | None = None
    sample_seed: int = 0
    since: str | None = None
    good_quality: tuple[str, ...] = ()
    auto_modes: tuple[str, ...] = ()
    max_bytes: int = 2 << 30
    tags: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for name, allowed in {"decimal": (".", ","), "time-format": (*TIME_WORDS, "a pattern as '%d.%m.%Y %H:%M:%S'"),
                              "interpolation": ("hold", "linear"), "layout": ("wide", "tall", "long", "pairs")}.items():
            value = getattr(self, name.replace("-", "_"))
            if value is not None and value not in allowed and not (name == "time-format" and "%" in value):
                words = ("  " if name == "decimal" else ", ").join(allowed)
                raise UsageError(f"{value!r} is not known here", where=f"--{name}", remedy=f"one of: {words}")
        if self.delimiter is not None:
            named = {"tab": "\t", "\\t": "\t", "comma": ",", "semicolon": ";", "pipe": "|", "space": " "}
            object.__setattr__(self, "delimiter", named.get(self.delimiter.lower(), self.delimiter))
            if len(self.delimiter) != 1 or self.delimiter in '\r\n"0123456789.':
                raise UsageError(**explained("delimiter", text=self.delimiter), where="--delimiter")
        for name, known in (("encoding", "".encode), ("timezone", ZoneInfo)):
            text = getattr(self, name)
            try:
                _ = text is None or known(text)
            except Exception:  # zoneinfo raises many kinds for odd names: all mean the same here
                hint = nearest(text, [z for z in available_timezones() if "/" in z and z[:4] != "Etc/"])
                hint = f"{hint} Or " if hint.startswith("did") else ""
                raise UsageError(**explained(name, text=text, hint=hint), where=f"--{name}") from None
        if self.header_row is not None and self.header_row < 1:
            raise UsageError("lines are counted from 1", where="--header-row", remedy="give the line's number")
        [*map(check_pattern, self.loops_matching)]
        if self.sample is not None:
            sample_size(self.sample, 1)
        if self.since is not None:
            parse_since(self.since, self.timezone)
