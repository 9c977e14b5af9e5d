"""What single cells of the first lines look like; only used on some dozens of lines to find the layout."""

from __future__ import annotations

import re

_NUMBER = re.compile(
    r"^[+-]?(?:\d{1,3}(?:[ .,'’\u00a0\u202f]\d{3})+(?:[.,]\d+)?|\d+(?:[.,]\d*)?|[.,]\d+)(?:[eEdD][+-]?\d+)?$"
)
_WITH_UNIT = re.compile(r"^[+-]?\d[\d.,'’]*(?:[eE][+-]?\d+)?\s?[^\d\s:;,|][^:;,|]{0,15}$")
_WORDS = re.compile(r"^[+-]?(?:inf(?:inity)?|nan|1\.#\w+)$", re.IGNORECASE)
_DATE = (r"(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4}"
         r"|\d{1,2}[-/. ]+[^\W\d]{3,12}\.?[-/. ,]+\d{2,4}"
         r"|\d{4}[-/. ][^\W\d]{3,12}\.?[-/. ]\d{1,2}|[^\W\d]{3,12}\.? \d{1,2},? \d{4}|(?:19|20)\d{6})")  # fmt: skip
_CLOCK = r"\d{1,2}[:.h]\d{2}(?:[:.]\d{2}(?:[.,:]\d+)?)?\s*(?:[AaPp]\.?\s?[Mm]\.?)?"
_ODD = re.compile(r"^(?:[^\W\d]{3} [^\W\d]{3}\s+\d{1,2} (?:[\d:]+ .*\d{4}|\d{4} [\d:]+.*)|\d{4}年.*)$")
_TIME = re.compile(
    rf"^(?:[^\W\d]{{2,10}},?\s+)?(?:{_DATE}(?:[T_ ,]+{_CLOCK}|T?\d{{6}}(?:\.\d+)?)?)\s*[A-Za-z0-9+:\-]{{0,8}}$"
)
_COMPACT = re.compile(r"^(?:19|20)\d{6}[T ]?\d{4,6}(?:[.,]\d+)?Z?$")
_CLOCK_ONLY = re.compile(r"^\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?\s*(?:[AaPp]\.?\s?[Mm]\.?)?$")


def kind(cell: str) -> str:
    """Return "empty", "time" (date, with or without clock), "clock", "number" or "text".

    >>> [kind(c) for c in ("17-Mar-26 08:00:00", "08:00:00", "4,050.7", "405.3 m3/h", "Bad Input", "")]
    ['time', 'clock', 'number', 'number', 'text', 'empty']
    """
    text = cell.strip(" \t\"'")
    if not text:
        return "empty"
    if len(text) > 60:
        return "text"
    if _NUMBER.match(text) or _WORDS.match(text):
        return "time" if _COMPACT.match(text) and len(text) >= 14 else "number"
    if _CLOCK_ONLY.match(text):
        return "clock"
    if _TIME.match(text) or _COMPACT.match(text) or _ODD.match(text):
        return "time"
    return "number" if _WITH_UNIT.match(text) else "text"


def split_line(line: str, delimiter: str) -> list[str]:
    """Split one line into cells; quotes are honoured, a quote that never ends is taken as it is."""
    if '"' not in line:
        return line.split(delimiter)
    cells: list[str] = []
    position, size = 0, len(line)
    while position <= size:
        if line.startswith('"', position):
            end = position + 1
            while True:
                end = line.find('"', end)
                if end < 0:
                    return cells + line[position:].split(delimiter)
                if line.startswith('""', end):
                    end += 2
                    continue
                break
            stop = line.find(delimiter, end)
            stop = size if stop < 0 else stop
            cells.append(line[position + 1 : end].replace('""', '"') + line[end + 1 : stop])
        else:
            stop = line.find(delimiter, position)
            stop = size if stop < 0 else stop
            cells.append(line[position:stop])
        position = stop + 1
    return cells


def lines_of(text: str) -> list[tuple[int, int, str]]:
    """Return (line number from 1, character offset, text) of every logical line; quotes may hold line ends."""
    found: list[tuple[int, int, str]] = []
    position, number = 0, 1
    ends = re.compile(r"\r\n|\n|\r")
    while position < len(text):
        end = ends.search(text, position)
        stop, following, breaks = (end.start(), end.end(), 1) if end else (len(text), len(text), 1)
        if text.count('"', position, stop) % 2 and end:
            # an open quote: go on to the line end that closes it, if one comes soon
            probe, count = following, 1
            while count < 8 and probe < len(text):
                end = ends.search(text, probe)
                until, probe_next = (end.start(), end.end()) if end else (len(text), len(text))
                count += 1
                if text.count('"', position, until) % 2 == 0:
                    stop, following, breaks = until, probe_next, count
                    break
                probe = probe_next
        found.append((number, position, text[position:stop]))
        number += breaks
        position = following
    return found
