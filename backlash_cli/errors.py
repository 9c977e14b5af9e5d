"""The project's own errors: each says what is wrong, where, and how to mend it."""

from collections.abc import Iterable, Sequence


class BacklashError(Exception):
    """Something the user can mend: `what` went wrong, `where` (file, line, column, loop), and the `remedy`; `code` is
    the machine-readable reason that reports carry."""
    code = "error"

    def __init__(self, what: str, *, where: str = "", remedy: str = "", code: str | None = None) -> None:
        super().__init__(what)
        self.what, self.where, self.remedy, self.code = what, where, remedy, code or self.code

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" if self.where else self.what
        return f"{text} -> {self.remedy}" if self.remedy else text


class InputError(BacklashError):
    """A file or folder that cannot be read as an export."""
    code = "unreadable_input"


class MetadataError(BacklashError):
    """Loop settings (`loops.toml`, CSV table, model or scenario file) that are wrong or incomplete."""
    code = "bad_metadata"


class LoopError(BacklashError):
    """One loop that cannot be analysed; the others go on."""
    code = "loop_refused"


class UsageError(BacklashError):
    """The command line asks for something that does not exist or does not fit together."""
    code = "wrong_use"


def nearest(name: str, known: Iterable[object]) -> str:
    """Return a phrase with the known names closest to `name`, for the remedy of an error.

    >>> nearest("Tii", ["K", "Ti", "Td"])
    'did you mean Ti, Td?'"""
    from difflib import get_close_matches

    names = [str(k) for k in known]
    lower = {n.lower(): n for n in names}
    hits = [lower[h] for h in get_close_matches(name.lower(), list(lower), cutoff=0.5)]
    if hits:
        return f"did you mean {', '.join(hits)}?"
    return f"known: {some(names, 12)}" if names else "none are known here"


def some(words: Sequence[str], most: int = 8, size: int = 40) -> str:
    """Return the first of some words, shortened to a size, to be shown in a message."""
    shown = ", ".join(word.strip()[:size] or "(blank)" for word in words[:most])
    return f"{shown} and {len(words) - most} more" if len(words) > most else shown
