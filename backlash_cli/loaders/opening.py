"""From a path to UTF-8 text in whole lines, or to Parquet: compression, encodings, archives, workbooks, what is no
export; and how a text is written: delimiter, header, units row, decimal sign, told from its first lines."""

import bz2
import codecs
import contextlib
import csv
import gzip
import io
import lzma
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache, lru_cache, partial, reduce
from itertools import accumulate, chain, islice, pairwise
from pathlib import Path, PurePosixPath
from typing import Any
from zipfile import BadZipFile, ZipFile

import pyarrow as pa

from ..errors import InputError
from ..places import Remote
from ..record import Note
from .cells import decimal_sign
from .layouts import Head, span_above
from .names import COLUMNS, FORM, SIGNALS, WORDS, explained, is_column, is_whole, noted, plain, signal_role, split_tag
from .options import DELIMITERS, ReadOptions
from .sources import day_of, is_export, stem_of
from .states import quality_words
from .times import StampReader, stamp_kind, zone_of

CHUNK, SAMPLE, BLOCK, ROWS = 1 << 17, 64 << 10, 4 << 20, 2000  # bytes read, that tell the encoding, of a block; lines
BOMB_RATIO, BOMB_FLOOR = 200, 64 << 20  # text of measurements never shrinks so far: a trap, no export
_CODECS: dict[bytes, tuple[str, Callable[[Any], Any]]] = {
    b"\x1f\x8b": ("gzip", gzip.open), b"BZh": ("bz2", bz2.open), b"\xfd7zXZ\x00": ("xz", lzma.open),
    b"\x28\xb5\x2f\xfd": ("zstd", lambda file: pa.CompressedInputStream(pa.PythonFile(file, mode="r"), "zstd"))}
_DAMAGED = (OSError, EOFError, zlib.error, lzma.LZMAError, ValueError, BadZipFile, pa.ArrowException)
_MARKS = {"utf-8": (codecs.BOM_UTF8,), "utf-32": (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE),
          "utf-16": (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)}  # that of utf-32 begins with that of utf-16
CODE_PAGES = ("cp1252", "cp932", "euc_jp", "gb18030", "cp949", "big5", "cp1251", "cp1250", "cp1254", "cp1253")
WORKBOOKS = (".xlsx", ".xlsm")
_REWRITTEN = [(re.compile(test), [(re.compile(old.encode()), new.encode()) for old, new in changes])
              for test, *changes in WORDS["lines"]["rewritten"]]
# A row of measurements begins with its stamp or a number, or has a stamp and something behind it.
_ROW = re.compile(rb"[\s\"',;]*\d|.*[,;\t] *\"?(?:\d{1,4}[-/.:]\d\d?[-/.:]|\d{9})\d[^,;\t]*[,;\t][\s,;\t]*[^\s,;\t]")
HEAD_LINES, HEAD_SIZE, JOINED, MOST_TABLES = 100, 160_000, 40, 1000  # first lines, characters; of a cell; in a text
Line = tuple[int, int, str]


def kind_of(path: Path | Remote, magic: bytes = b"") -> str:
    """Return "parquet", "workbook", "archive" or "text" for what begins so. Raises InputError for what is no export."""
    try:
        if not path.is_file():
            lost = isinstance(path, Path) and path.is_symlink() and not path.exists()
            raise InputError(**explained("closed_folder" if path.is_dir() else "not_found" if lost else "no_file"),
                             where=str(path))
        if not magic:
            with path.open("rb", buffering=0) as file:
                magic = file.read(512)
    except OSError as error:
        raise InputError(**explained("unreadable", problem=error.strerror or error), where=str(path)) from None
    if not magic:
        raise InputError(**explained("empty_file"), where=str(path))
    for begin, (what, remedy) in WORDS["foreign"].items():
        if re.match(begin.encode("latin-1"), magic, re.DOTALL):
            raise InputError(f"this is {what}, not CSV or Parquet", where=str(path), remedy=remedy)
    if magic.startswith((b"PK\x03\x04", b"PK\x05\x06")):  # the other: an archive without a file
        named = path.name.lower().endswith(WORKBOOKS)  # or the first file in it tells
        return "workbook" if named or re.match(rb"xl/|docProps/|_rels/|\[Content_Types\]", magic[30:]) else "archive"
    return "parquet" if magic.startswith(b"PAR1") else "text"


class Text:
    """The text of a file as UTF-8, in blocks of whole lines: `head`, and `rest`, to be gone through once; `notes` are
    complete then. taken: called with the bytes that were read. opened: gives a text that is but a part of the file.
    Raises InputError for what is no text or expands without end; of a damaged file what is whole is read."""

    def __init__(self, path: Path | Remote, options: ReadOptions, taken: Callable[[int], None] = lambda count: None,
                 opened: Callable[[], Any] | None = None) -> None:
        self.path, self.where, self.options, self._taken = path, str(path), options, taken
        self.notes: list[Note] = []
        self.rest = lines_together(self._decoded(self._pieces(opened)))
        self.head = next(self.rest, bytearray())

    def _pieces(self, part: Callable[[], Any] | None) -> Iterator[bytes]:
        size, total = self.path.stat().st_size, 0
        with part() if part else self.path.open("rb", buffering=0) as file:
            magic = b""
            with contextlib.suppress(BadZipFile):  # of a small part all is read: it is told below
                magic = file.read(16)
            file.seek(0)
            codec, opened = next((own for m, own in _CODECS.items() if magic.startswith(m)), ("zip" * bool(part), None))
            stream, told = opened(file) if opened else file, 0
            read = getattr(stream, "read1", stream.read)  # no more than one piece at once
            while True:
                try:
                    piece = read(CHUNK >> 4 if codec == "zstd" else CHUNK)  # of a damaged piece nothing is read
                except _DAMAGED as error:
                    if not codec:
                        raise
                    what = "the compressed stream ends too early" if isinstance(error, EOFError) else str(error)
                    # with a wrong checksum any part may be wrong; before foreign bytes all of it was whole
                    if total < 200 or (isinstance(error, (gzip.BadGzipFile, BadZipFile)) and "Not a gzip" not in what):
                        raise InputError(**explained("damaged", kind=codec, problem=what), where=self.where) from None
                    self.notes.append(noted("truncated", file=self.where, codec=codec, problem=what))
                    return
                self._taken(-told + (told := file.tell()))
                if not piece:
                    return
                total += len(piece)
                if codec and (total > self.options.max_bytes or (total > BOMB_FLOOR and total > BOMB_RATIO * size)):
                    raise InputError(**explained("bomb", size=size, codec=codec, MB=total >> 20), where=self.where)
                yield piece

    def _decoded(self, pieces: Iterator[bytes]) -> Iterator[bytes]:
        """Yield text as UTF-8; from the first bytes on that are not, it counts as of a `code_page`. Zero bytes, which
        stand for what was never written, end their line in a cell that is none."""
        head, where, begin = b"", self.where, 0
        while len(head) < SAMPLE and (piece := next(pieces, b"")):
            head += piece
        if not head:
            raise InputError(**explained("no_data"), where=self.where)
        if (kind := kind_of(self.path, head)) != "text":
            raise InputError(**explained("packed_twice", kind=kind.capitalize()), where=self.where)
        encoding = guess_encoding(head, self.path, self.options)
        decoder = codecs.getincrementaldecoder(encoding)("strict" if encoding in ("utf-8", "ascii") else "replace")
        for piece in chain([head.removeprefix(codecs.BOM_UTF8)], pieces, [b""]):
            if encoding != "utf-8" or not piece.isascii() or decoder.getstate()[0]:
                try:
                    text = decoder.decode(piece, final=not piece)
                except UnicodeError as odd:
                    if encoding != "utf-8":
                        raise InputError(**explained("encoding_wrong", form=encoding, text=odd), where=where) from None
                    piece, encoding = decoder.getstate()[0] + piece, code_page(head)
                    text = (decoder := codecs.getincrementaldecoder(encoding)("replace")).decode(piece)
                    self.notes.append(noted("encoding:page", encoding=encoding))
                if "\ufffd" in text and encoding != "utf-8" and not self.notes:
                    self.notes.append(noted("encoding", encoding=encoding))
                piece = text.encode("utf-8", errors="replace")
            if b"\0" in piece:
                if all(note.code != "truncated" for note in self.notes):
                    self.notes.append(noted("truncated:zeros", file=where, MB=(begin + piece.index(0)) / 1e6))
                piece = re.sub(rb"\0+", b"\0\n\0", piece)
            begin += len(piece)
            yield piece


def lines_together(pieces: Iterable[bytes]) -> Iterator[bytearray]:
    """Yield text in blocks of whole lines, larger ones of long lines: each block costs a little per column."""
    block, enough = bytearray(), BLOCK
    for piece in pieces:
        block += piece
        if len(block) < enough:
            continue
        end = b"\n" if b"\n" in block else b"\r"
        last = block.rfind(end)
        begin = block.rfind(b'"', 0, last)
        if block.count(b'"', 0, begin + 1) % 2:  # within a quoted cell, unless quotes never end
            last = block.rfind(end, 0, begin) if block.count(end, begin, last) < 200 else last
        rest, line = block[last + 1 :], last - block.rfind(end, 0, last)
        del block[last + 1 :]
        if block:
            yield block
        block, enough = rest, max(BLOCK, 2 * len(rest), min(ROWS * line, 4 * BLOCK))
    if block:
        yield block


def guess_encoding(head: bytes, path: Path | Remote, options: ReadOptions) -> str:
    """Return the encoding of text that begins with `head`. Raises InputError for binary data."""
    if marked := next((encoding for encoding, marks in _MARKS.items() if head.startswith(marks)), ""):
        return marked
    if options.encoding:
        return codecs.lookup(options.encoding).name
    sample = re.sub(rb"\0{16,}", b"", head[:SAMPLE]) or b"\0\0"  # what was never written is told later
    even, odd = sample[0::2].count(0), sample[1::2].count(0)
    if max(even, odd) > max(0.2 * len(sample), 8 * min(even, odd)):
        return "utf-16-le" if odd > even else "utf-16-be"
    if len(sample.translate(None, bytes({9, 10, 11, 12, 13, 26, 27, *range(32, 256)}))) > 0.02 * len(sample):
        raise InputError(**explained("binary"), where=str(path))
    return "utf-8"


def code_page(head: bytes) -> str:
    """Return the code page that makes known names, stamps or qualities of most cells, else the Western European one."""
    def known(page: str) -> int:
        cells = {*re.split(r'[,;\t|"\r\n]+', head[:SAMPLE].decode(page, "ignore"))}
        return sum(bool(is_column(c, *COLUMNS) or split_tag(c).role or kind(c) == "time" or quality_words([c], "named"))
                   for c in cells if not c.isascii())

    return max(CODE_PAGES, key=known)


def members(path: Path | Remote) -> Sequence[tuple[str, Callable[[], Any]]]:
    """Return (path in it, what opens it) of the exports in a zip archive. Both raise InputError, this without any."""
    def tried(opened: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return opened(*arguments)
        except (BadZipFile, OSError, ValueError, RuntimeError) as error:  # damaged, encrypted, packed in another way
            raise InputError(**explained("damaged_archive", problem=error), where=str(path)) from None

    archive = tried(lambda: ZipFile(path.open("rb", buffering=0)))
    found = [(n, partial(tried, archive.open, n)) for n in archive.namelist() if is_export(PurePosixPath(n).name)]
    if not found:
        raise InputError(**explained("empty_archive"), where=str(path))
    return found


def sheets(opened: Callable[[], Any], name: str, where: str) -> Sequence[tuple[str, Any]]:
    """Return (name, what opens it as CSV) of the sheets that hold more than a few cells: as files in a folder that is
    called as the workbook, the only one as the workbook itself. Raises InputError."""
    import pandas as pd
    try:
        with opened() as file, ZipFile(io.BytesIO(file.read())) as parts, ZipFile(told := io.BytesIO(), "w") as texts:
            for part in parts.namelist():  # errors such as #REF! as words: the library leaves their cells empty
                texts.writestr(part, parts.read(part).replace(b' t="e"', b' t="str"'))
        book = pd.read_excel(told, sheet_name=None, header=None, engine="calamine", na_filter=False)
    except Exception as error:  # the library raises kinds of its own for damaged workbooks
        code, problem = "no_calamine" if isinstance(error, ImportError) else "damaged_workbook", str(error).strip()
        raise InputError(**explained(code, problem=problem or type(error).__name__), where=where) from None
    found = [(f"{stem_of(name)}/{sheet}", partial(io.BytesIO, text.encode("utf-8-sig"))) for sheet, rows in book.items()
             if len(rows) > (len(book) > 1) and (text := rows.to_csv(header=False, index=False))]
    if not found:
        raise InputError(**explained("empty_workbook"), where=where)
    (first, as_text), *more = found
    return found if more or FORM.title.fullmatch(first.split("/")[-1]) else [(stem_of(name), as_text)]


def tables_below(opened: Callable[[], Text], notes: list[Note]) -> list[Callable[[], Any]]:
    """Return what opens the tables that stand one below the other in a text, each from the lines above its rows on; []
    where the first has all of these lines, as pages of one table have. notes: gets the text's. Raises InputError."""
    at, rows, lines = 0, False, list[bytes]()
    above, text = {0: lines}, opened()  # where tables may begin -> their lines above
    for line in chain.from_iterable(block.splitlines(True) for block in chain([text.head], text.rest)):
        if _ROW.match(line):
            rows = True
        elif line.strip():
            lines, rows = above.setdefault(at, []) if rows else lines, False
            lines.append(bytes(line.strip()))
        at += len(line)
        if max(len(above) - MOST_TABLES, len(lines) - HEAD_LINES) > 0:
            return []
    named = [at for at, own in above.items() if (rows or own is not lines) and any(  # not a last line that is cut off
        score_names(re.split(r"[,;\t|]", x.decode())) > 1.0 for x in own)]
    if {*chain(*(above[at] for at in named))} <= {*above[0]}:
        return []
    whole = b"".join([(text := opened()).head, *text.rest])
    notes += text.notes
    return [partial(io.BytesIO, codecs.BOM_UTF8 + whole[a:b]) for a, b in pairwise(sorted({0, *named, len(whole)}))]


def head_of(text: Text, stem: str, home: str) -> Head:
    """Find how a text is written. Raises InputError without a header, data, or anything that looks like columns."""
    (lines, end), options, where = lines_of(text.head), text.options, text.where
    declared = re.match(r"^sep=(.)$", lines[0][2].strip()) if lines else None
    lines = [row for row in lines[1 if declared else 0 :] if row[2].strip(" \t,;|")]
    if not lines:
        raise InputError(**explained("no_data"), where=where)
    if len(lines) == 1 and len(lines[0][2]) > SAMPLE:
        raise InputError(**explained("one_line", MB=len(text.head) / 1e6), where=where)
    last = range(len(lines) - min(24, max(1, len(lines) // 2)), len(lines))
    ruled = next((line.rstrip() for _, _, line in lines[:30] if FORM.ruler.match(line)), "")
    forms = (_at_edges(ruled), *_REWRITTEN) if ruled else _REWRITTEN
    for form, changes in () if options.delimiter or declared else forms:
        if 2 * sum(bool(form.match(lines[i][2])) for i in last) > len(last):
            rest = (bytearray(reduce(lambda old, one: one[0].sub(one[1], old), changes, bytes(block)))
                    for block in chain([text.head], text.rest))
            written, text.head, text.rest = text.head, next(rest), rest
            if text.head != written:  # or the lines only begin alike
                return head_of(text, stem, home)
    delimiter = options.delimiter or (declared[1] if declared else _delimiter(
        [lines[i][2] for i in last], [row[2] for row in lines[:30]]))
    cells = cache(lambda i: split_line(lines[i][2], delimiter))
    width = Counter(len(cells(i)) for i in last).most_common(1)[0][0]
    full = next((len(row) for row in map(cells, range(min(HEAD_LINES, len(lines)))) if len(row) > width > 1 and
                 [*map(kind, (row[0], row[1], row[width]))] == ["time", "number", "time"]), width)
    if full > width:  # of pairs: a spreadsheet ends a row behind the last cell that is not blank
        width, cells = full, cache(lambda i, own=cells: own(i) + [""] * (full - len(own(i))))
    enough = 6 if width > 300 else 24
    tail = [cells(i) for i in last if len(cells(i)) == width][-enough:]
    kinds = _column_kinds(tail, width)
    first = _first_row(lines, cells, kinds, options.header_row or 0)
    if first is None or all(k == "text" for k in kinds if k != "empty"):
        named = all(score_names(cells(i)) > 0 for i in range(min(10, len(lines))))
        late, empty = (options.header_row or 0) >= lines[-1][0], "time" in kinds and "number" not in kinds
        name = ("late_header" if late else "wrong_delimiter" if width < 2 and options.delimiter else "only_a_header"
                if named else "no_columns" if width < 2 else "no_numbers" if empty else "no_measurements")
        raise InputError(**explained(name, options=options, text=lines[-1][2].strip()[:60]), where=where)
    before = _by_legend({lines[i][0]: cells(i) for i in range(first)})
    data = [cells(i) for i in range(first, min(first + enough, len(lines)))]
    begun = _column_kinds([row for row in data if len(row) == width], width)  # a rare tag is empty at the end
    kinds = tuple(b if k == "empty" else k for k, b in zip(kinds, begun, strict=True))
    whole = (split_tag(word) for row in before.values() for c in row for word in (c, *c.replace('"', " ").split()))
    title = next((f"{t.loop}.{t.signal}" for t in whole if re.fullmatch(r"[^ ;,|]+", t.loop) and t.role in SIGNALS), "")
    if all(len(row) < width for row in before.values()):  # a line above, the file's name, or a tag in every row says it
        called = ["tag" if k == "text" and all(split_tag(cell).role in SIGNALS for cell in own) else "time" if k in (
            "time", "clock") else "value" if k == "number" and (kinds.count(k) < 2 or "." in "".join(own)) else ""
                  for k, own in zip(kinds, zip(*tail, strict=True), strict=True)]  # a measurement is not whole
        if {*called, "tag" if title or split_tag(stem).role in SIGNALS else ""} >= {"tag", "time", "value"}:
            before = {0: called} | before
    turn = len(cells(first)) != width and next(lines[i][0] for i in range(first, len(lines)) if len(cells(i)) == width)
    names = header_of(before, kinds, options, where + f" (from line {turn} on rows have {width} cells)" * bool(turn))
    text.notes += [noted("header_unused")] * any(options.columns and score_names(r) > 1 for r in before.values())
    kinds = tuple("clock" if is_column(name, "clock") and kinds.count("time") > 1 and all(
        FORM.dotted.match(row[i]) for row in tail) else kinds[i] for i, name in enumerate(names))
    signals = [i for i, name in enumerate(names) if split_tag(name).role in SIGNALS]  # others may differ
    every = [row[i] for row in (*data, *tail) if len(row) == width for i in signals if kind(row[i]) == "number"] or [
        c for row in (*data, *tail) for c in row if kind(c) == "number"]
    commas = [c for c in every if "," in c]  # between commas all numbers have one: not all would have thousands
    only_commas = len(commas) >= (len(every) if delimiter == "," else 1) > 0 and not any("." in c for c in every)
    numbers = commas if delimiter == "," else every
    if options.decimal and decimal_sign(every, options.decimal) != options.decimal:
        raise InputError(**explained("decimal_wrong", decimal=options.decimal, number=max(every, key=len)), where=where)
    if only_commas and not options.decimal and decimal_sign(numbers, ".") == ".":
        text.notes.append(noted("decimal_comma", number=numbers[0]))
    above = [(name, cell.strip(" ,;")) for row in before.values() if {*map(str.strip, row)} - {*names} for name, cell
             in (*pairwise(row), *((*re.split("[:=;]", cell, maxsplit=1), "")[:2] for cell in row))]
    # "Loop: FIC101", "Tag: FIC101", [FIC101] above "PV"; "Tag: FIC101.PV" above "Value" is the title
    loop = next((cell for name, cell in above if cell and is_column(name, "loop") and (
        delimiter != " " or re.search(r"\d", cell))), home) or next((  # between blanks: "this loop is in automatic"
        found[1] for row in reversed(before.values()) if (found := FORM.title.fullmatch(" ".join(row)))), "")
    # lines above, or a column, tell the zone and the order of dates: as if the header did
    zone = next((c.strip() for n, c in (*above, *zip(names, data[0], strict=False)) if is_column(n, "zone")), "")
    text.notes += [noted("zone_unknown", zone=zone)] * (bool(zone) and zone_of(f"({zone})") is None)
    told = [found[0] for form in (FORM.order, FORM.zone_told) for n, c in above if (found := form.search(f"{n} {c}"))]
    told = [" ".join(dict.fromkeys([*told, zone])).strip()]
    names = tuple(n + f" ({told[0]})" * bool(told[0] and is_column(n, "time") and n[-1] not in ")]") for n in names)
    names = tuple(n + span_above(i, split_tag(n).role, before) * (n[-1:] not in ")]") for i, n in enumerate(names))
    return Head(where, stem, names, (), kinds, title if title and any(is_column(n, "value") for n in names) else loop,
                options.decimal or decimal_sign(numbers, "," if only_commas else "."), delimiter, *lines[first][:2],
                end, 0 if "time" in kinds else _start_of(above, kinds, options, where, stem), _interval_of(above))


def _start_of(above: list[tuple[str, str]], kinds: Sequence[str], options: ReadOptions, where: str, stem: str) -> int:
    """The moment [microseconds since 1970] of lines above, as Start, or Date and Time; the day of file or folder; 0."""
    told = [(plain(name) in COLUMNS["start"], cell) for name, cell in above if is_column(name, "time", "start")]
    days, clocks = ([c for start, c in told if start and (kind(c) == own or (own == "time" and c.isdigit()))] or
                    [c for _, c in told if kind(c) == own] for own in ("time", "clock"))
    days = [*{*days}] or [*filter(None, map(day_of, (stem, *Path(where).parts[:-3:-1])))][:1] * ("clock" in kinds)
    reader = StampReader(["date"], ReadOptions(timezone=None if "clock" in kinds else options.timezone), where)
    with contextlib.suppress(InputError):  # an open one
        stamps = reader.take([pa.array([" ".join([*days, *clocks[-1:] * (":" not in "".join(days))])])])
        return max(int(reader.finish()(stamps)[0]), 0) if len(days) == 1 else 0
    return 0


def _interval_of(above: list[tuple[str, str]]) -> int:
    """The time [microseconds] between rows that lines above name, as Sample interval: 2 s, or SampleTime[ms]; or 0."""
    for name, cell in ((n, c) for n, c in above if plain(n) in COLUMNS["interval"]):
        if (rate := FORM.hertz.fullmatch(cell)) and (rate[2] or re.search(r"(?i)(rate|freq\w*)\s*([(\[]Hz.)?$", name)):
            return round(1e6 / float(rate[1]))
        with contextlib.suppress(InputError):
            return max(int(StampReader([name], ReadOptions(), "").take([pa.array([cell])])[0]), 0)
    return 0


def _at_edges(ruler: str) -> tuple[re.Pattern[str], tuple[tuple[re.Pattern[bytes], bytes], ...]]:
    """Lines as long as a ruler of dashes, and what puts tabs between the cells below its dashes, in bytes of UTF-8."""
    widths = [len(part) for part in ruler.split()[:-1]]
    cells = b" ".join(rb"((?:[^\n\x80-\xbf][\x80-\xbf]*){%d})" % width for width in widths)
    tabs = b"".join(rb"\%d\t" % number for number in range(1, len(widths) + 1))
    return re.compile(f".{{{ruler.rindex(' ')}}} "), (
        (re.compile(rb"(?m)^" + cells + b" "), tabs), (re.compile(rb" *\t *"), b"\t"), _REWRITTEN[0][1][0])


def _delimiter(lines: list[str], first: list[str]) -> str:
    """The one that cuts the lines into equally many times and numbers, and one of the `first` into names."""
    scores = dict.fromkeys(DELIMITERS, 0.0)
    for candidate in DELIMITERS:
        rows = [split_line(line, candidate) for line in lines]
        width, count = Counter(map(len, rows)).most_common(1)[0]
        if width < 2 or (candidate == " " and all(re.search(r"[\t;|]|\D,|,\D", line) for line in lines)):  # in cells
            continue
        kinds = [kind(cell) for row in rows if len(row) == width for cell in row[:40]]
        known, filled = len(kinds) - kinds.count("text"), len(kinds) - kinds.count("empty")
        named = (split_line(FORM.comment.sub("", line).lstrip(" "), candidate) for line in first if ": " not in line)
        begun = [{*map(kind, row[:40])} for row in named if len(row) == width]
        scores[candidate] = (count / len(rows) * (0.7 * known / len(kinds) + 0.3) * (filled / len(kinds)) ** 0.1
                             * (1.5 if {"text"} in begun or {"text", "empty"} in begun else 1.0))
    return max(DELIMITERS, key=scores.__getitem__)


def _column_kinds(rows: list[list[str]], width: int) -> tuple[str, ...]:
    counted = [Counter(k for row in rows if (k := kind(row[column])) != "empty") for column in range(width)]
    return tuple(found.most_common(1)[0][0] if found else "empty" for found in counted)


def _first_row(lines: list[Line], cells: Callable[[int], list[str]], kinds: tuple[str, ...], header: int) -> int | None:
    """The first row with stamps, or half of its numbers, where the last rows have them, as has another soon after."""
    times = [i for i, k in enumerate(kinds) if k in ("time", "clock")]
    wanted = times or [i for i, k in enumerate(kinds) if k == "number"][:50]

    @cache
    def is_data(row: int) -> bool:
        own = cells(row)
        found = [kind(own[i]) if i < len(own) else "empty" for i in wanted]
        hits = [f == kinds[i] or (f == "number" and kinds[i] == "time" and bool(FORM.count.match(own[i])))
                for f, i in zip(found, wanted, strict=True)]
        full = 2 * sum(bool(cell.strip()) for cell in own) > len(kinds)  # one moment above the header is not
        filled = not times or any(kind(cell) == "number" or (full and cell.strip()) for cell, k in zip(own, kinds)  # noqa: B905
                                  if (k == "number" if "number" in kinds else k not in ("time", "clock", "empty")))
        begun = hits if times else hits[:1]  # where no column holds stamps the first one is the time
        blank = found.count("empty") * bool(times or FORM.count.match(own[0]))  # 1773734400, and one value of many
        return any(begun) and filled and sum(hits) + blank >= len(wanted) / 2 and not (
            FORM.comment.match(own[0]) and kind(own[0]) == "text")

    count = len(lines)
    return next((i for i in range(count) if lines[i][0] > header and is_data(i)
                 and (i + 1 == count or any(map(is_data, range(i + 1, min(i + 4, count)))))), None)


def header_of(before: dict[int, list[str]], kinds: Sequence[str], options: ReadOptions, where: str) -> tuple[str, ...]:
    """Return the names from the lines above the data, by their numbers; a two-line header is put together."""
    width = len(kinds)
    if options.columns or options.header_row is not None:
        if options.columns and len(options.columns) != width:
            raise InputError(**explained("other_columns", names=len(options.columns), cells=width), where=where)
        given = list(options.columns) or before.get(options.header_row or 0)
        if not given or (not options.columns and score_names(given) < 0):  # numbers
            raise InputError(**explained("no_header_row", line=options.header_row), where=where)
        return tuple(_fit(given, width))
    rows = [cells[len(cells) > width and bool(FORM.comment.fullmatch(cells[0])) :] for cells in before.values()]
    rows = [cells[1:] if len(cells) > width and kinds[0] == "time" and is_column(cells[0], "time") and is_column(
        cells[1], "time", "clock") else cells for cells in rows]  # Date, Time above cells that hold both
    rows = [own for c in rows if _spans(own := c[:width] if is_column(c[-1], "ignored") else c, width)]  # no remarks
    notes = [c for c in rows if FORM.comment.match(c[0]) and not FORM.comment.fullmatch(c[0])]  # # heads numbers
    commented = [[FORM.comment.sub("", cells[0]).strip(), *cells[1:]] for cells in notes[-1:]]
    rows = [cells for cells in rows if cells not in notes] or [row for row in commented if score_names(row)]
    if not rows:
        line, cells = next(reversed(before.items()), (0, list[str]()))
        raise InputError(**explained("no_header:other" if any(cells) else "no_header", line=line, names=len(cells),
                                     cells=width, named=sum(map(bool, cells)), text=" ".join(cells)[:60]), where=where)
    # one cell too few: nothing stands above row numbers, or above the time of day
    unnamed = 0 if (*kinds[:2],) == ("number", "time") else kinds.index("clock") if "clock" in kinds[1:] else None
    rows = [row if len(row) != width - 1 or unnamed is None or kinds[-1] == "empty" else
            [*row[:unnamed], "", *row[unnamed:]] for row in rows[-24:]]
    best = max(range(len(rows)), key=lambda i: (sum(cell.strip().lower() in options.tags for cell in rows[i]) > 1,
                                                score_names(rows[i]), len(list(filter(None, rows[i]))), i))
    if "number" in kinds[len(rows[best]) :] and any(rows[best][1::2]):  # a tag above each time has nothing beside it
        raise InputError(**explained("short_header", names=len(rows[best]), cells=width), where=where)
    rows = [_fit(row, width) for row in rows]
    names = rows[best]
    whole, signals = any(map(is_whole, names)), [i for i, name in enumerate(names) if signal_role(name)]
    words = [plain(name) for name in names if name and not (  # a quality, a time stand beside each tag
        whole and is_column(name, "time", "quality", "ignored", "value"))]
    if len(set(words)) < len(words) or names.count("") > width / 3:  # the header goes on in other lines
        others = [row for part in (rows[:best], rows[best + 1 :][::-1]) for row in sorted(part, key=score_names)[::-1]
                  if "time" not in map(kind, row) and not is_column(row[0], "start", "bound")]  # no beginning, no end
        for _ in range(2):  # loop, signal, and value or quality may each have their own
            joined = max((_joined(names, other, kinds) for other in others), key=lambda row: len({*row}), default=names)
            names = joined if len({*joined}) > len({*names}) else names
    for other in rows[: best * (not whole and len(set(words)) == len(words) and names is rows[best])]:  # FIC101 above
        if len({other[i] for i in signals}) == 1 and re.fullmatch(r"\S*[^\W\d]\S*\d\S*", other[signals[0]]) and (
                not other[0] or is_column(other[0], "loop", "tag")):
            return tuple(_joined(names, other, kinds))
    return tuple(names)


def _by_legend(before: dict[int, list[str]]) -> dict[int, list[str]]:
    """Put tags in the place of a header's short names where lines before say so: A;FIC101.SP;Feed, Pen 1: FIC101.SP."""
    rows = (cells if len(cells) > 1 else re.split("[:=]", cells[0], maxsplit=1) for cells in before.values())
    told = {cells[0].strip(" #:"): tag for cells in rows if not is_whole(cells[0]) and (
        tag := min((cell for cell in cells[1:] if is_whole(cell)), key=lambda cell: " " in cell, default=""))}
    header = next((line for line, cells in before.items() if len({*told}.intersection(cells[1:])) > 1), None)
    return before if header is None else {header: [told.get(cell, cell) for cell in before[header]]}


def _spans(cells: list[str], width: int) -> bool:
    """A header covers the columns, give or take empty ones at the end."""
    filled = [i for i, cell in enumerate(cells) if cell.strip()]
    used = filled[-1] + 1 if filled else 1
    return used <= width and (len(cells) >= width - 1 or used >= max(2, width // 2)) and len(filled) > (width > 2)


def score_names(cells: list[str]) -> float:
    """How much a line looks like a header: points for names that are known, off for numbers and times."""
    points = 0.0
    for i, cell in enumerate(cells[:2000]):  # of more these tell enough
        if split_tag(cell).role or signal_role(cell):
            points += (1.4 if " " in split_tag(cell).loop else 2.0) if split_tag(cell).loop else 1.0  # Feed flow SP
        elif is_column(cell, "time", "tag", "value", "loop"):
            points += 1.5 if i == 0 else 1.0
        elif kind(cell) in ("number", "time", "clock"):
            points -= 1.0
    return points


def _joined(names: list[str], other: list[str], kinds: Sequence[str]) -> list[str]:
    """Two lines of names as one; a name counts for blanks on its right, as a merged cell does, over filled columns."""
    merged = names.count("") > max(len(names) / 3, other.count(""))  # SP, PV, OP, each above all loops
    high, low = (names, other) if merged or score_names(names) < score_names(other) else (other, names)
    tags = [word for word in low if is_whole(word)]
    enough = {*tags, ""} if len({*tags}) == len(tags) > 0 else set()  # tags below the channels of a recorder say it all
    result, upper = [], ""
    for cell, word, kind, before in zip(high, low, kinds, ["", *low[:-1]], strict=True):
        unit = is_column(before, "time") and is_column(word, "value") and is_whole(upper) and not is_whole(cell)
        upper = upper if unit else cell or (upper if word or kind != "empty" else "")
        tag = split_tag(upper)
        part = bool(word) and not is_column(word, "value") and (  # below a whole tag a unit may stand
            not (tag.loop and tag.role) or is_column(word, "time", "quality", "statistic", "units"))
        result.append(word if (word or cell) in enough else f"{upper}.{word}" if upper and part else upper or word)
    return result


def _fit(cells: Sequence[str], width: int) -> list[str]:
    return [cell.strip().lstrip("\ufeff") for cell in (*cells[:width], *[""] * (width - len(cells)))]


@lru_cache(1 << 14)
def kind(cell: str) -> str:
    """Return "empty", "time" (date, with or without clock), "clock", "number" (as 4,050.7 or 405.3 m3/h) or "text"."""
    text = cell.strip(" \t\"'")
    if not text or len(text) > 60:
        return "text" if text else "empty"
    if FORM.number.match(text):
        return "time" if len(text) >= 14 and stamp_kind(text) else "number"
    return stamp_kind(text) or ("number" if FORM.with_unit.match(text) else "text")


def split_line(line: str, delimiter: str) -> list[str]:
    """Split one line into cells; quotes are honoured."""
    if '"' in line:
        with contextlib.suppress(csv.Error):  # of quotes that are none
            return next(csv.reader([line], delimiter=delimiter), [""])
    return line.split(delimiter)


def lines_of(text: bytes | bytearray) -> tuple[list[Line], int]:
    """Return (number, offset in bytes, text) of the first lines, which quotes may join, and where they end."""
    found: list[Line] = []
    stream = io.TextIOWrapper(pa.BufferReader(text), "utf-8", newline="")  # any kind of line end
    lines, at, offset = [*islice(stream, HEAD_LINES), *stream.readlines(HEAD_SIZE)], 0, 0
    last = len(lines) - JOINED * bool(stream.read(1))
    while at < last:
        # an open quote: go on to the line that closes it, if one comes soon
        count = 1 if lines[at].count('"') % 2 == 0 else next((k for k, quotes in enumerate(accumulate(
            line.count('"') for line in lines[at : at + JOINED]), 1) if quotes % 2 == 0), 1)
        line = "".join(lines[at : at + count])
        found.append((at + 1, offset, line.rstrip("\r\n")))
        offset += len(line.encode())
        at += count
    return found, offset
