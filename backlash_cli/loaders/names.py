"""Names of columns and tags: which signal of which loop is this?"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# Names of one signal, written without blanks, dots, dashes and underscores, in lower case.
SIGNALS = {
    "sp": """sp sv spt setpoint setpt setval setvalue spv wsp spwrk spint spactual activesp spact sollwert consigne w
        target spvalue""",
    "pv": """pv meas measurement measured measuredvalue procvalue processvalue processvariable istwert pvin pvvalue
        mesure pvact""",
    "op": """op mv co out output cout opout lmn stellgroesse stellwert controlleroutput ctrlout ctloutput outvalue
        opvalue controloutput manipulatedvariable y outputpct pidout pidoutput""",
    "mode": """mode md modeact modeactual actualmode modattr controlmode ctrlmode controllermode betriebsart automan
        manauto am""",
}
QUALITY = _words(
    """quality qual q status st stat dataquality opcquality qualitycode confidence state valid isgood good statuscode
    qc"""
)
TIME = _words(
    """time timestamp times timestamps datetime dateandtime datetimeutc ts t date zeit zeitstempel datum datumzeit
    datumuhrzeit uhrzeit utc localtime utctime timeutc timelocal sampletime samplingtime eventtime sourcetimestamp
    servertimestamp timestring timecode recordtime timeepoch horodatage heure dateheure fecha hora fechahora index
    epoch unixtime epochtime timems timesec seconds sec elapsed elapsedtime"""
)
TAG = _words(
    """tag tagname name point pointname pointid signal signalname variable varname item itemid itemname metric series
    parameter channel sensor tagid tagpath messstelle historiantag pitag node nodeid browsename field key"""
)
VALUE = _words(
    """value val values wert valeur valor data reading average avg mean numericvalue floatvalue measurementvalue vvalue
    rawvalue doublevalue v last curval"""
)
LOOP = _words("loop loopname controller loopid pid loopno loopnumber unitloop regelkreis boucle")
ATTRIBUTES = _words("fcv cv value val pv f current present presentvalue curval raw data")
IGNORED = _words("result table start stop count samples no nr row rownumber id comment comments remark bemerkung")

_LOOKUP = {word: role for role, words in SIGNALS.items() for word in words.split()}
_SEPARATORS = r"[.\-_/:\\|# ]"
_SERVER = re.compile(r"^\\\\[^\\]+\\")  # \\SERVER\ before a tag
_UNIT = re.compile(r"\s*(?:\[[^\]]*\]|\([^)]*\))\s*$")


@dataclass(frozen=True)
class Tag:
    """A name taken apart: `loop`, `role` ("sp", "pv", "op", "mode", "quality", "time" or "" for another signal),
    `signal` (the last part as written) and, for quality and time columns, `of`: the tag they belong to."""

    loop: str
    role: str
    signal: str
    of: str = ""


def plain(text: str) -> str:
    """Return the text in lower case without blanks, dots, dashes, underscores and a unit in brackets at the end."""
    return re.sub(r"[\s._\-/:\\#*'\"|]+", "", _UNIT.sub("", text)).lower()


def without_unit(text: str) -> str:
    """Return the name without a unit in brackets: "FIC101.PV [m3/h]" -> "FIC101.PV"."""
    return _UNIT.sub("", text.strip())


def signal_role(text: str) -> str:
    """Return "sp", "pv", "op", "mode" when the whole text is a usual name of that signal, else ""."""
    return _LOOKUP.get(plain(text), "")


def is_time_name(text: str) -> bool:
    """Say whether a header names a column of time stamps."""
    word = plain(text)
    return word in TIME or (word.startswith(("timestamp", "datetime", "zeitstempel")) and len(word) < 24)


@lru_cache(maxsize=65536)
def split_tag(text: str) -> Tag:
    """Take a tag or column name apart.

    >>> split_tag("FIC101.PV").loop, split_tag("FIC101_OUT").role, split_tag("FIC101.PV.Quality").of
    ('FIC101', 'op', 'FIC101.PV')
    """
    name = _SERVER.sub("", without_unit(text))
    parts = [m for m in re.finditer(rf"(?:^|{_SEPARATORS}+)([^.\-_/:\\|# ]+)", name)] if len(name) < 20_000 else []
    if len(parts) < 2:
        return Tag("", signal_role(name), name)
    last = plain(parts[-1][1])
    if last in QUALITY and len(parts) >= 2:
        base = name[: parts[-1].start()]
        if split_tag(base).role or len(parts) >= 2:
            return Tag(split_tag(base).loop, "quality", parts[-1][1], of=base)
    if last in TIME and len(parts) >= 2:
        base = name[: parts[-1].start()]
        return Tag(split_tag(base).loop, "time", parts[-1][1], of=base)
    for words in (1, 2):  # "FIC101 Set Point" has a signal name of two words
        if len(parts) > words:
            cut = parts[-words].start()
            role = signal_role(name[cut:])
            if role and not (words == 2 and signal_role(parts[-1][1])):
                return Tag(name[:cut], role, parts[-words][1] if words == 1 else name[cut:].strip(" .-_/:"))
    if (len(parts) > 2 and last in ATTRIBUTES | {"fcv"}) or (
        len(parts) > 3 and plain(name[parts[-2].start() :]) in ATTRIBUTES
    ):
        for drop in (1, 2):
            if len(parts) > drop + 1:
                inner = split_tag(name[: parts[-drop].start()])
                if inner.role in SIGNALS:
                    return inner
    return Tag(name[: parts[-1].start()], "", parts[-1][1])
