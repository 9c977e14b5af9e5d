"""Names of columns and tags: which signal of which loop is this? Known words and forms are in words.toml."""

import re
from functools import lru_cache
from itertools import product
from types import SimpleNamespace
from unicodedata import normalize

from ..record import Frozen
from ..words import Words

WORDS, explained, noted = (_own := Words(__package__)).tables, _own.explained, _own.noted
SIGNALS: dict[str, str] = WORDS["signals"]
COLUMNS = {kind: frozenset(words.format_map(WORDS["columns"]).split()) for kind, words in WORDS["columns"].items()}
_LIKE = {kind: re.compile(test.replace("TIME", "|".join(COLUMNS["time"]))) for kind, test in WORDS["like"].items()}
_LOOKUP = {word: role for role, words in SIGNALS.items() for word in words.split()}
_FORMS = WORDS["forms"] | {name: "(?i)" + "|".join(words.split()) for name, words in WORDS["words"].items()}
FORM = SimpleNamespace(**{name: re.compile(form.replace("TAG", _FORMS["tag"])) for name, form in _FORMS.items()})
NESTED_LIMIT = 500  # longer names are taken apart once only


class Tag(Frozen):
    """A name taken apart: `role` ("sp", "pv", "op", "mode", "quality", "time", "" for another signal), `signal` (the
    last part as written) and, of quality and time columns, `of`: the tag they belong to."""

    loop: str
    role: str
    signal: str
    of: str = ""


@lru_cache(1 << 18)
def plain(text: str) -> str:
    """Return the text in lower case without blanks, dots, dashes, underscores and a unit in brackets at the end."""
    return re.sub(r"[\s.,_\-/:\\#*'\"|$~!>]+", "", FORM.unit.sub("", normalize("NFKC", text))).lower()


def bare_tag(text: str) -> str:
    """Return a tag in lower case without a server before it and a unit in brackets behind it."""
    return FORM.unit.sub("", FORM.server.sub("", text.strip())).rstrip().lower()


def undated(stem: str) -> str:
    """Return the name of a file without the dates, perhaps with times, around it: FIC101.PV_20260302_2155."""
    return (len(stem) <= NESTED_LIMIT and FORM.dated.sub("", stem)) or stem


def span_of(unit: str, role: str) -> tuple[float, float] | None:
    """Return the range that a unit tells, in brackets behind a name or alone: 0..60 m3/h, 3 to 15 of an OP in psi."""
    unit = (found[0] if (found := FORM.unit.search(unit)) else unit).strip("[]() ")
    usual = WORDS["spans"].get(unit.lower(), "0 0") if role == "op" else "0 0"
    ends = (found[1], found[2]) if (found := FORM.span.fullmatch(unit)) else usual.split()
    low, high = (float(end.replace(",", ".")) for end in ends)
    return (low, high) if low < high else None


def is_whole(text: str) -> bool:
    """Say whether a text names a signal and its loop, as FIC101.PV does."""
    tag = split_tag(text)
    return bool(tag.loop) and tag.role in SIGNALS


def signal_role(text: str) -> str:
    """Return "sp", "pv", "op", "mode" when the whole text is a usual name of that signal, else ""."""
    return _LOOKUP.get(plain(text)) or _LOOKUP.get(plain(FORM.typed.sub("", text)), "")


def is_column(text: str, *kinds: str) -> bool:
    """Say whether a header names a column of one of some kinds; time stamps and qualities by a part of it as well."""
    word = plain(text)
    return any(word in COLUMNS[kind] or (kind in _LIKE and bool(_LIKE[kind].match(word))) for kind in kinds)


def _labelled(name: str) -> str:
    """Return FIC101.pv for pid_pv{job="opc", loop="FIC101"}: a label names the loop; and for FIC101.pv {host: a}."""
    metric, _, rest = name.rpartition("{")
    labels = {plain(key): value.strip() for key, value in FORM.label.findall(rest)}
    metric = metric.strip() or labels.pop("name", "")
    tags = {text: split_tag(text) for text in (metric, *labels.values()) if text}
    signals = [text for text, tag in tags.items() if tag.role in SIGNALS]
    if not labels or not signals or (tags[signals[0]].loop and signals[0] != metric):
        return signals[0] if labels and signals else name  # a label is the whole tag
    loop, tag = ([labels[key] for key in labels if key in COLUMNS[kind]] for kind in ("loop", "tag"))
    loops = [one for one in (*loop, *re.findall(r".*\d.*", split_tag(metric).loop), *tag, *tags) if one not in signals]
    return f"{loops[0]}.{tags[signals[0]].signal}" if loops else name


def in_labels(text: str) -> str:
    """Return FIC101 of loop=FIC101,site=A, as InfluxDB writes what a row belongs to; other texts as they are."""
    if not re.fullmatch(r"\w+=[^,;=]*(?:,\w+=[^,;=]*)*", text):
        return text
    labels = {plain(key): value.strip() for key, value in FORM.label.findall(text)}
    return next((labels[k] for kind in ("loop", "tag") for k in labels if k in COLUMNS[kind]), text.rpartition("=")[2])


@lru_cache(1 << 18)
def split_tag(text: str) -> Tag:
    """Take a tag or column name apart: FIC101.PV.Quality tells the quality `of` FIC101.PV, FIC101_OUT is an output."""
    name = FORM.framed.sub(r"\1", FORM.glued.sub(" ", FORM.server.sub("", normalize("NFKC", text).strip())))
    name = FORM.compact.sub(r"\1.MODE", name.replace('"', "") if name[:1] == '"' else FORM.levels.sub(r"\1.\2", name))
    pieces = [p for p in FORM.piece.split(name.rpartition("{")[2] if len(name) <= NESTED_LIMIT else "") if p]
    if len(pieces) == 2 and signal_role(pieces[0]) and FORM.tag.fullmatch(pieces[1]):  # SP (FIC101)
        return split_tag(f"{pieces[1]}.{pieces[0]}")
    if len(pieces) == 2 and re.search(" [-–—] |: ", name) and signal_role(pieces[1]) and not signal_role(pieces[0]):
        return Tag(pieces[0], signal_role(pieces[1]), pieces[1])  # Feed Flow Controller - Output
    if (is_column(name, "tag", "value", "units") or plain(name) in COLUMNS["time"]) and not signal_role(name):
        return Tag("", "", name)
    known = any(plain(piece) in COLUMNS["time"] or is_column(piece, "statistic", "quality") for piece in pieces)
    if len(pieces) > 1 and name[:1] != "[" and not known:
        whole = {tag for p in pieces if FORM.whole.fullmatch(p) and (tag := split_tag(p)).role in SIGNALS and (
            (p == pieces[0] and " " not in p) or re.search(r"[^\W\d].*\d|\d.*[^\W\d]", tag.loop))}
        if len(whole) == 1:
            return whole.pop()
    name = _labelled(name) if "{" in name and len(name) <= NESTED_LIMIT else name
    if bracket := FORM.bracket.match(name) if len(name) <= NESTED_LIMIT else None:
        before, role = bracket[1], signal_role(bracket[2])
        name = (f"{before}.{bracket[2]}" if (role and role != split_tag(before).role) or (
            is_column(bracket[2], "statistic", "quality")) else before or bracket[2])
    parts = list(FORM.part.finditer(name))
    if len(parts) < 2:
        return Tag("", signal_role(name), name)
    last, cut = plain(parts[-1][1]), parts[-1].start()
    if plain(name[parts[-2].start() :]) in COLUMNS["quality"]:  # FIC101.PV_is_good
        last, cut = "quality", parts[-2].start()
    marks = (is_column(last, "quality") and not signal_role(name[parts[-2].start() :])) or (  # Auto Status is a mode
        last in COLUMNS["fault"] and is_whole(name[:cut]))
    if (marks or last in COLUMNS["time"]) and len(name) <= NESTED_LIMIT:
        return Tag(split_tag(name[:cut]).loop, "quality" if marks else "time", parts[-1][1], of=name[:cut])
    rest = name[parts[0].end() :].strip(" .-_/:|")
    if len(name) <= NESTED_LIMIT and is_column(parts[0][1], "quality", "value") and is_whole(rest):
        tag = split_tag(rest)  # Quality FIC101.PV, value_FIC101.PV
        return Tag(tag.loop, "quality", parts[0][1], of=rest) if is_column(parts[0][1], "quality") else tag
    # PLANT.FIC101_PV.F_CV before what the data base calls the value; "FIC101 Set Point" of two words; FIC101.PV
    dots = "." in name  # C.SP is the setpoint of a loop C, L SP a local one
    for drop, words in product(range(min(3, len(parts)), -1, -1), (3, 2, 1)):
        kept, end = parts[: len(parts) - drop], parts[-drop].start() if drop else len(name)
        if len(kept) >= words and (words == 1 or kept[-words].start() or not (dots and signal_role(kept[-1][1]))) and (
                not drop or plain(name[end:]).removeprefix("in") in COLUMNS["attribute"] or (
                    {plain(part[1]) for part in parts[-drop:]} <= COLUMNS["attribute"])):
            cut = kept[-words].start()
            if role := signal_role(name[cut:end]):
                loop = found[1] if (found := FORM.described.fullmatch(name[:cut])) else name[:cut]  # FIC101 Valve
                named = split_tag(loop) if len(name) <= NESTED_LIMIT else Tag("", "", "")  # FIC101.SP Setpoint
                return named if named.role == role and re.search(r"\d", named.loop) else Tag(
                    loop, role, kept[-1][1] if words == 1 else name[cut:end].strip(" .-_/:|"))
    for words in (3, 2, 1)[len(parts) < 3 :]:  # Set point temperature, PV_FIC101
        if (first := signal_role(begun := name[: parts[words - 1].end()].strip(" .-_/:|"))) and len(begun) > 1 and not (
                is_column(parts[-1][1], "time")):
            return Tag(name[parts[words - 1].end() :].strip(" .-_/:|#"), first, begun)
    return Tag(name[: parts[-1].start()], "", parts[-1][1])
