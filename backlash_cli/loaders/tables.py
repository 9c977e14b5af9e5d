"""Files to signals: Arrow reads text in blocks, Parquet in batches of rows or a column when a loop asks."""

import contextlib
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from itertools import accumulate, chain, filterfalse, islice
from sys import intern
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
from numpy.typing import NDArray

from ..errors import BacklashError, InputError
from ..places import Remote
from ..record import NAT, IntArray, Note
from ..scratch import Piece, Room
from .cells import BLANK, Cells, Lexicon, codes_and_words, decimal_sign, is_number, is_text, stored
from .grid import CLOCK_CODES, ordered
from .layouts import LOOP, VALUE, Head, Layout, layout_of, of_tag, signals_of
from .names import FORM, SIGNALS, explained, in_labels, is_column, noted, signal_role, span_of, split_tag, undated
from .opening import WORKBOOKS, Text, head_of, kind, kind_of, members, score_names, sheets, split_line, tables_below
from .options import DELIMITERS, ReadOptions
from .signals import Axis, Series, Store
from .sources import Source, stem_of, told_by
from .states import mode_words
from .times import StampReader, micros_of

TOGETHER, LEAST, MOST = 2 << 20, 1500, 1 << 19  # cells of one piece, in memory 4 times as many; its rows
FEW, HEAD_ROWS = 3, 4000  # steps back of stamps that may be a clock that was set back; of Parquet looked at first
MAX_GROWTH = 1000  # bytes decoded per byte of a large Parquet file; constant columns reach some hundred
KEPT, SHOWN = 200, 50  # characters of a line that is dropped, and lines of which they are
_WORDS = pa.dictionary(pa.int32(), pa.string())
Batch = dict[int, pa.ChunkedArray]


class TextTable:
    """A text file as a table: its first rows, then all of it in batches of columns."""

    def __init__(self, text: Text, stem: str, home: str) -> None:
        self.text, self.where, self.notes, self.head = text, text.where, text.notes, head_of(text, stem, home)
        self._bad: list[tuple[int, int, int, str]] = []  # cells expected and found, lines, text
        self.named_again = self._quoted = False  # lines or cells below rows name something; the last block has quotes
        first = self._parsed(text.head[self.head.offset : self.head.end], None)
        if first.num_rows == 0:
            below = " below the header" + "; a quotation mark is not closed" * (text.head.count(b'"') % 2)
            raise InputError(**explained("no_rows", below=below), where=self.where)
        self.head = replace(self.head, columns=tuple(first.columns))

    def batches(self, columns: Collection[int], stamps: Collection[int], size: int) -> Iterator[Batch]:
        """Yield the columns that are asked for, about `size` cells at a time, once. stamps: which are stamps."""
        types: dict[int, pa.DataType | None] = {}
        for i in {*columns, *stamps}:  # as their first rows are, numbers as float64 and words as a dictionary
            kind = self.head.columns[i].type
            plain = pa.float64() if is_number(kind) or pa.types.is_null(kind) else pa.string()
            types[i] = _WORDS if is_text(kind) or (i in stamps and "%" in (self.text.options.time_format or "")) else (
                plain if i not in stamps else None if pa.types.is_null(kind) else kind)
        self._bad, mark, line, first_bad = [], self.head.delimiter.encode(), self.head.first_line, 0
        del self.text.head[: self.head.offset]
        tables: list[pa.Table] = []
        for block in filterfalse(bytearray.isspace, chain([self.text.head], self.text.rest)):
            before = len(self._bad)
            try:
                table = self._parsed(block, types)
            except pa.ArrowInvalid:
                del self._bad[before:]
                table = self._parsed(block, dict.fromkeys(types))
            # a quotation mark that is not closed takes in the rows that follow, without a trace if no cell is missing
            counted = table.num_rows + sum(bad[2] for bad in self._bad[before:])
            within = bytes(block).split(b'"')[1::2] if self._quoted and block.count(b"\n") > counted else []
            self._bad += [(0, 0, lost, part[:KEPT].decode(errors="replace")) for part in within if (
                lost := sum(line.count(mark) + 1 == len(self.head.names) for line in part.split(b"\n")[1:]))]
            if self._bad and not first_bad:
                begun = [re.escape(text.partition("\n")[0].encode()) + rb"\r?$" * (  # found in any order
                    len(text) < KEPT and "\n" not in text) for *_, text in self._bad[:SHOWN]]
                place = re.search(rb"(?m)^(?:%s)" % b"|".join(begun), block)
                first_bad = line + block.count(b"\n", 0, place.start() if place else 0)
            del block  # its memory, warm in the cache, is that of the next one
            line, rows = line + counted, sum(one.num_rows for one in tables)
            if tables and (table.schema != tables[0].schema or rows > min(max(size // len(types), LEAST), MOST)):
                yield dict(zip(types, pa.concat_tables(tables).columns, strict=True))
                tables = []
            tables.append(table)
        yield dict(zip(types, pa.concat_tables(tables).columns, strict=True))
        if self._bad:
            (full, got, _, text), rows = self._bad[0], float(sum(bad[2] for bad in self._bad))
            other = next((mark for mark in DELIMITERS[:-1] if text.count(mark) == full - 1 > 0), "")
            code = "ragged_rows:delimiter" if other else "ragged_rows"
            self.notes += [noted("ragged_rows:quote" if rows > len(self._bad) or not full else code, {"rows": rows,
                "file": self.where}, line=first_bad, got=got, cells=full, text=text[:40], other=other)]

    def _parsed(self, block: bytes | bytearray, types: dict[int, pa.DataType | None] | None) -> pa.Table:
        names, self._quoted = [f"c{i}" for i in range(len(self.head.names))], b'"' in block  # they may be alike

        def on_bad_row(row: pa_csv.InvalidRow) -> str:
            lines, text = 1 + row.text.count("\n"), row.text[:KEPT] * (len(self._bad) < SHOWN)
            self._bad += [(row.expected_columns, row.actual_columns, lines, text)] * (not FORM.footer.match(row.text))
            self.named_again |= score_names(split_line(row.text, self.head.delimiter)) > 0
            return "skip"

        chosen = {} if types is None else {"include_columns": [names[i] for i in types], "column_types": {
            names[i]: kind for i, kind in types.items() if kind is not None}}
        threads = types is not None and pa.cpu_count() > 1  # the first rows are few
        size = max(1 << 20, min(len(block), LEAST // 3 * block.find(b"\n")))  # warm in the cache, and not of few rows
        reading = pa_csv.ReadOptions(column_names=names, use_threads=threads, block_size=size if all(
            block.find(b"\n", at, at + size) >= 0 for at in range(0, len(block), size)) else len(block))  # long lines
        parsing = pa_csv.ParseOptions(delimiter=self.head.delimiter, newlines_in_values=self._quoted,
                                      quote_char=self._quoted and '"', invalid_row_handler=on_bad_row)
        converting = pa_csv.ConvertOptions(decimal_point=self.head.decimal, null_values=["", " ", *BLANK],
            quoted_strings_can_be_null=True, strings_can_be_null=True, auto_dict_encode=True,
            auto_dict_max_cardinality=4096, true_values=["\x00"], false_values=["\x00"], **chosen)
        before, mark, full, fitted = len(self._bad), re.escape(self.head.delimiter.encode()), len(names), block
        table = pa_csv.read_csv(pa.BufferReader(block), reading, parsing, converting)
        for got in {min(bad[1], full + 1) for bad in self._bad[before:]}:  # blank cells behind the last column are none
            if got > full or self.head.kinds[0] == self.head.kinds[got] == "time":  # or those of pairs that have ended
                row = rb'(?:[^"\n%b]*%b){%d}[^"\n%b]*?' % (mark, mark, min(got, full) - 1, mark)
                less, more = mark + b"[%b ]*" % mark if got > full else b"", self.head.delimiter.encode() * (full - got)
                fitted = re.sub(rb"(?m)^(%b)%b(\r?)$" % (row, less), lambda m, more=more: m[1] + more + m[2], fitted)
        if fitted is not block and fitted != block:  # each is some megabytes
            del self._bad[before:]
            return self._parsed(fitted, types)
        return table


@lru_cache(16)
def open_parquet(path: Any) -> pa_parquet.ParquetFile:
    """Open a file, or return it as it was opened lately. Raises InputError where it is damaged."""
    try:
        far = isinstance(path, Remote)  # where one long read costs less than several
        return pa_parquet.ParquetFile(path.open() if far else pa.OSFile(str(path)), pre_buffer=far)
    except FileNotFoundError:
        raise InputError(**explained("not_shared"), where=str(path)) from None
    except (pa.ArrowException, OSError) as error:
        raise _damaged(str(error), path) from None


@lru_cache(2)  # stamps and cells of the rows that are read next
def _cells_of(file: pa_parquet.ParquetFile, group: int, name: str) -> list[pa.Array]:
    return file.read_row_group(group, columns=[name], use_threads=False).flatten().column(0).chunks


def _damaged(problem: str, path: Any) -> InputError:
    problem = problem.strip().split("\n")[0][:200]
    return InputError(**explained("damaged", kind="Parquet", problem=problem), where=str(path))


class ParquetTable:
    """A Parquet file as a table, or as rows whose columns are read when asked for, also in another process."""

    def __init__(self, path: Any, stem: str, options: ReadOptions, home: str) -> None:
        self.path, self.where, self.options = path.absolute(), str(path), options
        open_parquet.cache_clear()  # the file may have changed
        file = open_parquet(path)
        about, schema, size = file.metadata, file.schema_arrow, path.stat().st_size
        self.count, decoded = about.num_rows, about.num_rows * about.num_columns * 8
        if decoded > options.max_bytes and decoded > MAX_GROWTH * size:
            raise InputError(**explained("bomb", size=size, codec="Parquet", MB=decoded >> 20), where=self.where)
        if not self.count:
            raise InputError(**explained("no_rows", below=""), where=self.where)
        self._ends = [*accumulate(about.row_group(k).num_rows for k in range(about.num_row_groups))]
        fields = [*chain.from_iterable(field.flatten() for field in schema)]  # FIC101.SP
        self._names = [field.name for field in fields]
        if len(set(self._names)) < len(fields):
            twice = next(name for name, count in Counter(self._names).items() if count > 1)
            raise InputError(**explained("same_names", tag=twice[:60]), where=self.where)
        # cells tell about the layout only where they are no plain measurements
        tell = pa.schema([f for k, f in enumerate(fields) if k == 0 or not pa.types.is_floating(f.type)])
        alone = len(tell) == 1 and pa.types.is_timestamp(tell.types[0])  # its type says all
        begun = pa.Table.from_batches([*islice(file.iter_batches(HEAD_ROWS, columns=tell.names), not alone)],
                                      tell if alone else None).flatten()
        first = {f.name: pa.chunked_array([], f.type) for f in fields} | {c: begun[c] for c in begun.column_names}
        words = [[word for word in codes_and_words(c.slice(0, 50))[1] if word.strip()] if is_text(c.type) else []
                 for c in first.values()]
        kinds = tuple(Counter(map(kind, own)).most_common(1)[0][0] if own else "" for own in words)
        self.head = Head(self.where, stem, tuple(self._names), tuple(first.values()), kinds, home, decimal_sign(
            [word for own in words for word in own if kind(word) == "number"], "."))
        self.decimal, self.notes, self.named_again = self.head.decimal, list[Note](), False

    def batches(self, columns: Collection[int], stamps: Collection[int], size: int) -> Iterator[Batch]:
        """Yield the columns that are asked for, about `size` cells at a time."""
        wanted = sorted({*columns, *stamps})
        for batch in open_parquet(self.path).iter_batches(min(MOST, 1 + size // len(wanted)),
                                                          columns=[self._names[i] for i in wanted], use_threads=False):
            table = pa.Table.from_batches([batch]).flatten()
            yield {i: table.column(self._names[i]) for i in wanted}

    def cells(self, column: str, first: int, last: int, group: int = 0) -> Cells:
        """Return the cells of rows first..last-1 of the column "v3"."""
        words: dict[str, int] = {}
        values, codes = stored(self._column(int(column[1:]), first, last), words, self.decimal)
        return Cells(values, codes, Lexicon(list(words), self.decimal))

    def stamps(self, column: str, first: int, last: int, group: int = 0) -> IntArray:
        """Return the stamps of rows first..last-1 of the column "v0" [microseconds since 1970 UTC]."""
        return micros_of(self._column(int(column[1:]), first, last))

    def _column(self, at: int, first: int, last: int) -> pa.ChunkedArray:
        name, ends = self._names[at], self._ends
        groups = range(bisect_right(ends[:-1], first), bisect_right(ends[:-1], last - 1) + 1)
        begin = ends[groups[0] - 1] if groups[0] else 0
        try:
            column = pa.chunked_array(chain(*(_cells_of(open_parquet(self.path), k, name) for k in groups)))
        except (pa.ArrowException, OSError) as error:
            raise _damaged(str(error), self.path) from None
        if len(column := column.slice(first - begin, last - first)) == last - first:
            return column
        raise _damaged(f"column {name[:60]} has {len(column)} rows of {last - first}", self.path)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "head": None}


def signals_of_file(source: Source, options: ReadOptions, needed: Callable[[Series], bool], room: Room,
                    taken: Callable[[int], None]) -> tuple[list[Series], list[Note], dict[str, InputError]]:
    """Return the signals of a file, what was noticed, and which files of an archive cannot be read; sheets of remarks
    are passed over. Raises InputError. needed: says which signals are. taken: called with the bytes that were read."""
    path, stem, kind = source.path, undated(stem_of(source.path.name)), kind_of(source.path)
    if kind == "parquet":
        taken(path.stat().st_size)
    parts: list[tuple[str, Callable[[], Any] | None]] = [*members(path)] if kind == "archive" else [
        (path.name, partial(path.open, "rb", buffering=0) if kind == "workbook" else None)]
    found, notes, problems, lost = list[Series](), list[Note](), list[InputError](), dict[str, InputError]()
    given, called = len(parts), Counter(undated(stem_of(name.rpartition("/")[2])) for name, _ in parts)
    for number, (name, opened) in enumerate(parts):  # a workbook is followed by its sheets, a text by its tables
        *folders, file = name.split("/")  # a part of an archive or a workbook is as a file in a folder
        home = told_by((stem, *folders), file, called) if kind in ("archive", "workbook") else source.home
        own, signals, problem, text = undated(stem_of(file)), list[Series](), None, None
        table: TextTable | ParquetTable | None = None
        try:
            if opened and number < given and (kind == "workbook" or name.lower().endswith(WORKBOOKS)):
                parts += sheets(opened, name, str(path) if kind == "workbook" else f"{path}: {name}")
                continue
            table = ParquetTable(path, own, options, home) if kind == "parquet" else TextTable(
                text := Text(path, options, taken, opened), own, home)
            signals = _signals(table, layout_of(table.head, options), options, needed, room)
        except InputError as error:
            problem = error
        if text and (table is None or table.named_again) and (
                below := tables_below(partial(Text, path, options, opened=opened), notes)):
            parts += [(name, one) for one in below]
        elif problem:
            problems.append(problem)
            if number < given and kind == "archive":
                lost[f"{path}: {name}"], problem.where = problem, f"{path}: {name}"
            else:
                notes.append(noted("passed_over", name=own, error=problem))
        elif table:
            found, notes = found + signals, notes + table.notes
    if problems and not found:
        raise problems[0]
    return found, notes, lost


def _signals(table: TextTable | ParquetTable, layout: Layout, options: ReadOptions,
             is_needed: Callable[[Series], bool], room: Room) -> list[Series]:
    """Store stamps in UTC ("t0" ...) and cells ("v3" ...), rows of many tags by tag; Parquet may stay in its file."""
    head, columns = table.head, sorted({*layout.values, *chain(*layout.quality.values())})
    spare = {*head.times, *(i for i, name in enumerate(head.plain) if name in VALUE)}.difference(
        columns, layout.naming, layout.further, *layout.stamps)
    table.notes += [noted("not_read", name=head.names[i]) for i in sorted(spare)]
    table.notes += [noted("quality_unused", column=head.names[i]) for i in sorted({*layout.values}.difference(
        *layout.quality.values())) if head.tags[i].role == "quality" or (not head.tags[i].role and head.marks(i))]
    blank = {i for i in columns if pa.types.is_null(head.columns[i].type)}
    kinds = [head.columns[i].type for pair in layout.stamps for i in pair]
    if not layout.naming and isinstance(table, ParquetTable) and len(kinds) == len(layout.stamps) and all(
            pa.types.is_timestamp(kind) and (kind.tz or not options.timezone) for kind in kinds):
        axes = [Axis(table, f"v{i}", range(table.count), where=head.where, called=head.stem,
                     zones=frozenset([bool(k.tz)])) for (i, *_), k in zip(layout.stamps, kinds, strict=True)]
        return _on_axes(signals_of(head, layout, options, blank), axes, layout)
    if not layout.naming:  # what is still blank may be a tag of the loops file
        needed = {i for one in signals_of(head, layout, options) if is_needed(one) for i in (one.column, *one.marks)}
        columns = [i for i in columns if i in needed or i in blank]
    readers = [StampReader([head.names[i] for i in pair], options, head.where, [head.parts.get(i, "") for i in pair],
                           head.start, head.interval, head.decimal == ",") for pair in layout.stamps]
    raw, store, keys, blank = Store(room), Store(room), dict[str, int](), set(columns)
    words: dict[int, dict[str, int]] = {i: {} for i in columns}
    further = dict.fromkeys(layout.values, layout.further)
    above = {i: pa.nulls(1, pa.string()) for i in (*layout.naming, *(day for day, *rest in layout.stamps if rest)) if (
        is_text(head.columns[i].type) and 2 * head.columns[i].null_count > len(head.columns[i]))}
    size = min(max(TOGETHER, room.left >> 3), 4 * TOGETHER)  # in memory fewer pieces need putting together
    for batch in table.batches([*columns, *layout.naming, *layout.further], {*chain(*layout.stamps)}, size):
        for i, last in above.items():  # a report, as merged cells, names tag or day in the first row of its block
            cells = pa.concat_arrays([last, batch[i].cast(pa.string()).combine_chunks()])
            cells = pc.fill_null_forward(pc.if_else(pc.equal(cells, head.names[i]), None, cells))  # no header again
            above[i], batch[i] = cells[-1:], pa.chunked_array([cells[1:]])
        piece: Piece = {f"t{k}": reader.take([batch[i] for i in pair])
                        for k, (reader, pair) in enumerate(zip(readers, layout.stamps, strict=True))}
        for i in columns:
            values, codes = stored(batch[i], words[i], head.decimal, written=isinstance(table, TextTable))
            for other in further.get(i, ()):
                more, others = stored(batch[other], words[i], head.decimal, written=isinstance(table, TextTable))
                codes, others = (np.full(len(values), -1, np.int32) if c is None else c for c in (codes, others))
                empty = np.isnan(values) & (codes < 0)
                values, codes = np.where(empty, more, values), np.where(empty, others, codes)
            name = intern(f"v{i}")  # pieces of a large file are many
            piece |= {name: values} if codes is None else {name: values, f"{name}w": codes}
            if i in blank and (codes is not None or not np.isnan(values).all()):
                blank.remove(i)
        if layout.naming:
            piece["group"] = _numbered(batch, layout.naming, head, keys)
        raw.add(piece)
    # of words that are the same behind their last digit, as numbers with a unit are, one is looked at
    told = {FORM.to_digit.sub("", word): word for own in words.values() for word in own}.values()
    table.named_again |= any(score_names([word]) > 0 and not mode_words([word]) for word in told)
    table.notes += [noted("named_above", column=head.names[i]) for i in above]
    clocks = [reader.finish() for reader in readers]
    for piece in raw.emptied():
        store.add({**piece, **{f"t{k}": clock(piece[f"t{k}"][:]) for k, clock in enumerate(clocks)}})
    store.lexicons = {f"v{i}": Lexicon(list(found), head.decimal) for i, found in words.items() if found}
    axes = [Axis(store, f"t{k}", range(store.rows().sum()), notes=reader.all_notes, where=head.where, called=head.stem,
                 first_line=head.first_line, zones=reader.zones) for k, reader in enumerate(readers)]
    if layout.naming:
        tags = _tags(keys, any(head.plain[i] in LOOP for i in layout.naming[:-1]))
        return _by_tag(axes[0], store, tags, blank, head, layout)
    return _on_axes(signals_of(head, layout, options, blank), axes, layout)


def _on_axes(signals: list[Series], axes: list[Axis], layout: Layout) -> list[Series]:
    if layout.kind == "pairs":  # shorter ones are padded with rows without a stamp
        axes = [axis.part(slice(0, 1 + int(np.flatnonzero(axis.read() != NAT).max(initial=-1)))) for axis in axes]
    return [replace(one, axis=axes[one.stamps]) for one in signals]


def _numbered(batch: Batch, naming: Sequence[int], head: Head, keys: dict[str, int]) -> NDArray[np.int32]:
    """Return the number of each row's key, the cells that name its tag; -1 for none, such as a header in between, or a
    signal without its loop; new keys are added."""
    header, column = "\0".join(head.names[i].strip() for i in naming), batch[naming[0]]
    column = column.cast(pa.int64(), safe=False) if pa.types.is_floating(column.type) else column
    if len(naming) > 1:
        column = pc.binary_join_element_wise(*(pc.fill_null(batch[i].cast(pa.string()), "") for i in naming), "\0")
    codes, words = codes_and_words(column)
    table = np.full(len(words) + 1, -1, np.int32)
    for i in np.flatnonzero(np.bincount(codes + 1)[1:]).tolist():
        key = [in_labels(cell.strip()) for cell in words[i].split("\0")]
        tag = split_tag(key[-1])
        if key[-1].strip("-=") and "\0".join(key) != header and (all(key[-2:]) or tag.loop or tag.role not in SIGNALS):
            table[i] = keys.setdefault("\0".join(key), len(keys))
    return table[codes]


def _tags(keys: Collection[str], of_loop: bool) -> list[str]:
    """The tags of keys. A cell beside, of the unit or the module, belongs to the tag where it tells two tags apart, or
    where these name a block, or a signal only. of_loop: so does one that names the loop."""
    cells = [key.split("\0") for key in keys]
    tags = [split_tag(own[-1]) for own in cells]
    least = 1 + (of_loop or any(FORM.block.fullmatch(f".{t.loop}") or (t.role in SIGNALS and not t.loop) for t in tags))
    while cells and len(cells[0]) > least and len({(*own[1:],) for own in cells}) == len(cells):
        cells = [own[1:] for own in cells]
    for own, tag in zip(cells, tags, strict=True):  # pid_sp of a loop is its SP
        own[-1] = tag.signal if own[1:] and tag.role in SIGNALS and not re.search(r"\d", tag.loop) else own[-1]
    return [".".join(filter(None, own)) for own in cells]


def _by_tag(axis: Axis, store: Store, tags: list[str], blank: set[int], head: Head, layout: Layout) -> list[Series]:
    """Put the rows of each tag, or of each loop of a tall file, together."""
    tall = layout.kind == "tall"
    moved, notes = ([], []) if tall else _one_clock(store, f"v{layout.values[0]}", len(tags))
    grouped, first, nameless, undated = Store(store.room, grouped=True), 0, 0, 0
    grouped.lexicons = store.lexicons
    for piece in store.emptied():
        micros = piece["t0"][:]
        for row, shift in moved:
            micros = np.where((np.arange(first, first + len(micros)) > row) & (micros != NAT), micros + shift, micros)
        first += len(micros)
        named, known = piece["group"][:] >= 0, micros != NAT
        keep, nameless = named & (tall | known), nameless + int(np.count_nonzero(~named & known))
        undated += int(np.count_nonzero(named & ~known & (not tall)))  # and no headers in between, which have no number
        grouped.add({name: (micros if name == "t0" else column[:])[keep] for name, column in piece.items()})
    notes += [noted("no_tag", rows=nameless)] * bool(nameless)
    notes += [noted("unreadable_times", {"rows": float(undated)}, at="")] * bool(undated)
    axis = replace(axis, rows=grouped, first_line=0, notes=(*axis.notes, *notes))
    modes = [] if any(tag.role == "mode" for tag in head.tags) else [  # status: AUTO, MANUAL
        i for i in layout.values if i in head.texts and mode_words(head.words(i))]
    found, unread = [], {*blank, *chain(*layout.quality.values())}
    for number, tag in enumerate(tags):
        if count := int(grouped.rows(number).sum()):
            own = replace(axis, which=range(count), group=number)
            for i in (i for i in layout.values if not tall or i not in unread):
                name = f"{tag}.{head.names[i]}" if tall else f"{head.stem}.{tag}" if signal_role(tag) else tag
                one, role = of_tag(head, layout, name, i), "mode" if i in modes else signal_role(head.names[i])
                units = [unit for mark, called in one.marks.items() if is_column(called, "measure")  # as behind a name
                         for unit in own.part(slice(0, 1)).cells(f"v{mark}").texts()[1] if span_of(unit, one.role)]
                one = replace(one, tag=f"{one.tag} [{units[0]}]") if units else one
                found += [replace(replace(one, loop=tag, signal=head.names[i], role=role) if tall else one, axis=own)]
    return found


def _one_clock(store: Store, column: str, tags: int) -> tuple[list[tuple[int, int]], list[Note]]:
    """After which rows by how much [microseconds] the clock was set back for all tags, also rarely recorded; notes."""
    back: list[int] = []
    first, before, counts = 0, -(1 << 62), np.zeros(tags + 1, np.int64)
    for piece in store.pieces:
        micros = piece["t0"][:]
        known = np.flatnonzero(micros != NAT)
        back += (first - 1 + known[np.diff(micros[known], prepend=before) < 0]).tolist() if len(known) else []
        before, first = int(micros[known[-1]]) if len(known) else before, first + len(micros)
        counts += np.bincount(piece["group"][:] + 1, minlength=tags + 1)
    if not 0 < len(back) <= FEW:
        return [], []
    usual = int(np.argmax(counts[1:]))
    times, values = (np.concatenate([p[n][:][p["group"][:] == usual] for p in store.pieces]) for n in ("t0", column))
    clock: list[Note] = []
    with contextlib.suppress(BacklashError):
        clock = [note for note in ordered(times, values).notes if note.code in CLOCK_CODES]
    return ([(row, round(float(note.values["seconds"]) * 1e6)) for row, note in zip(back, clock, strict=True)], clock
            ) if len(clock) == len(back) else ([], [])
