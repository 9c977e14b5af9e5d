"""One column of a CSV on its way through the blocks into the store."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .arrays import to_array, to_texts
from .numbers import BLANK, plain_numbers
from .stored_columns import TAG


class ForeignText(Exception):
    """The table of the whole file would differ from that of its blocks."""


@dataclass
class Signal:
    """One stored column on its way through the blocks: its words by code, and what has been seen. met: the bits that
    stand for words met among numbers."""

    words: dict[str, int] = field(default_factory=dict)
    met: dict[str, int] = field(default_factory=dict)
    filled: bool = False
    not_finite: bool = False

    def take(self, column: pa.ChunkedArray, out: NDArray[np.float64], decimal: str) -> None:
        """Put the cells of a block into `out`. Raises ForeignText."""
        self.filled |= column.null_count < len(column)
        if pa.types.is_floating(column.type):
            out[:] = to_array(column)
            # as words they would count as bad values of a column of text
            self.not_finite |= bool(np.count_nonzero(~np.isfinite(out)) > column.null_count)
        else:
            coded = column.combine_chunks().dictionary_encode()
            coded = coded.combine_chunks() if isinstance(coded, pa.ChunkedArray) else coded
            bits = self._bits(coded.dictionary, decimal)
            codes = to_array(coded.indices.fill_null(len(bits)))
            out[:] = np.append(bits, TAG).view(np.float64)[codes]
        if self.words and self.not_finite:
            raise ForeignText

    def take_words(self, found: list[tuple[int, int, str]], out: NDArray[np.float64], decimal: str) -> None:
        """Put words where the bits that stand for them are in `out`, each from its row on. Raises ForeignText."""
        from .csv_kernel import put_words

        new = [word for word in dict.fromkeys(word for _, _, word in found) if word not in self.met]
        if new:
            self.filled |= any(word not in BLANK and word not in ("", " ") for word in new)
            self.met.update(zip(new, self._bits(to_texts(new), decimal).tolist(), strict=True))
        events, rows = np.array([event for event, _, _ in found]), np.array([row for _, row, _ in found])
        put_words(out.view(np.int64), rows, events, np.array([self.met[word] for _, _, word in found]))
        if self.words and self.not_finite:
            raise ForeignText

    def _bits(self, words: pa.Array, decimal: str) -> NDArray[np.int64]:
        """Return what stands for each word: the bits of its number, or of its code."""
        values = plain_numbers(words, decimal)
        bits = values.view(np.int64)
        for i in np.flatnonzero(np.isnan(values)).tolist():
            word = words[i].as_py()
            blank = word in BLANK or not word or word.isspace()
            bits[i] = TAG if blank else TAG + 1 + self.words.setdefault(word, len(self.words))
        return bits
