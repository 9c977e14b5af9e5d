"""Names of columns and tags: which signal of which loop is this?"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from itertools import product


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
    """quality qual q status st stat dataquality opcquality qualitycode confidence state valid validity isgood good
    statuscode qc opcstatus datastatus valuestatus pointstatus tagstatus questionable güte"""
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
    rawvalue doublevalue v last curval varvalue realvalue datavalue pointvalue tagvalue"""
)
LOOP = _words("loop loopname controller loopid pid loopno loopnumber unitloop regelkreis boucle")
ATTRIBUTES = _words("fcv cv value val pv f current present presentvalue curval raw data avg mean last average")
IGNORED = _words("result table start stop count samples no nr row rownumber id comment comments remark bemerkung")

_LOOKUP = {word: role for role, words in SIGNALS.items() for word in words.split()}
NESTED_LIMIT = 500  # longer names are taken apart once only
_PART = re.compile(r"(?:^|[.\-_/:\\|# ]+)([^.\-_/:\\|# ]+)")
_BRACKET = re.compile(r"^(.+?)\s*[\[(]([^\[\]()]+)[\])]$")
_JOINED = re.compile(r"^(.*\d)(SP|SV|PV|OP|MV|CO|OUT|MODE|MD)$")  # FIC101PV
_SERVER = re.compile(r"^\\\\[^\\]+\\")  # \\SERVER\ before a tag
_UNIT = re.compile(r"\s*(?:\[[^\]]*\]|\([^)]*\))\s*$")
_DESCRIBED = re.compile(r"^([^\s:,;]+)(?:\s+[-–—]\s+|[:,;]\s+)(\S.*)$")  # FIC101.PV - Feed flow


@dataclass(frozen=True)
class Tag:
    """A name taken apart: `role` ("sp", "pv", "op", "mode", "quality", "time", "" for another signal), `signal` (the
    last part as written) and, of quality and time columns, `of`: the tag they belong to."""

    loop: str
    role: str
    signal: str
    of: str = ""


@lru_cache(1 << 16)
def plain(text: str) -> str:
    """Return the text in lower case without blanks, dots, dashes, underscores and a unit in brackets at the end."""
    return re.sub(r"[\s._\-/:\\#*'\"|]+", "", _UNIT.sub("", text)).lower()


def signal_role(text: str) -> str:
    """Return "sp", "pv", "op", "mode" when the whole text is a usual name of that signal, else ""."""
    return _LOOKUP.get(plain(text), "")


def is_time_name(text: str) -> bool:
    """Say whether a header names a column of time stamps."""
    word = plain(text)
    return word in TIME or (word.startswith(("timestamp", "datetime", "zeitstempel")) and len(word) < 24)


def is_quality_name(word: str) -> bool:
    """Say whether a plain word names a column that says which samples are good."""
    return word in QUALITY or (("valid" in word or "qualit" in word or "gültig" in word) and len(word) < 24)


@lru_cache(maxsize=65536)
def split_tag(text: str) -> Tag:
    """Take a tag or column name apart.

    >>> split_tag("FIC101.PV").loop, split_tag("FIC101_OUT").role, split_tag("FIC101.PV.Quality").of
    ('FIC101', 'op', 'FIC101.PV')
    """
    name = _SERVER.sub("", text.strip())
    described = _DESCRIBED.match(name) if len(name) <= NESTED_LIMIT else None
    if described and plain(described[2]) not in TIME and not is_quality_name(plain(described[2])):
        tag = split_tag(described[1])
        if tag.loop and tag.role in SIGNALS:
            return tag
    bracket = _BRACKET.match(name) if len(name) <= NESTED_LIMIT else None
    name = f"{bracket[1]}.{bracket[2]}" if bracket and signal_role(bracket[2]) else _UNIT.sub("", name)
    parts = list(_PART.finditer(name))
    if len(parts) < 2:
        glued = None if signal_role(name) else _JOINED.match(name)
        return Tag(glued[1], signal_role(glued[2]), glued[2]) if glued else Tag("", signal_role(name), name)
    last = plain(parts[-1][1])
    marks = is_quality_name(last)
    if (marks or last in TIME) and len(name) <= NESTED_LIMIT:
        base = name[: parts[-1].start()]
        return Tag(split_tag(base).loop, "quality" if marks else "time", parts[-1][1], of=base)
    # FIC101.PV; "FIC101 Set Point" of two words; PLANT.FIC101_PV.F_CV before what the data base calls the value
    for drop, words in product((0, 1, 2), (1, 2)):
        kept = parts[: len(parts) - drop]
        end = parts[-drop].start() if drop else len(name)
        if len(kept) > words and (not drop or plain(name[end:]) in ATTRIBUTES):
            cut = kept[-words].start()
            if role := signal_role(name[cut:end]):
                return Tag(name[:cut], role, kept[-1][1] if words == 1 else name[cut:end].strip(" .-_/:"))
    first = signal_role(parts[0][1])
    if first and len(parts[0][1]) > 1 and not is_time_name(parts[-1][1]):  # PV_FIC101
        return Tag(name[parts[1].start() :].strip(" .-_/:|#"), first, parts[0][1])
    return Tag(name[: parts[-1].start()], "", parts[-1][1])
