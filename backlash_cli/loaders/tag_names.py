"""Which tag each row of a long file belongs to, block by block."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .csv_signal import ForeignText
from .numbers import codes_and_words


class TagNames:
    """Gives the tags of a long file their codes. wanted: says of a tag whether its rows will be needed."""

    def __init__(self, wanted: Callable[[str], bool] = lambda name: True) -> None:
        self.wanted = wanted
        self.kept: list[bool] = []
        self._codes: dict[tuple[str, ...], int] = {}
        self._places: list[dict[str, int]] = [{}, {}]  # of words in their columns, as they come

    def codes(
        self, columns: Sequence[pa.ChunkedArray], known: NDArray[np.bool_] | None = None
    ) -> NDArray[np.int32]:
        """Return the code of each row's tag in a block, -1 for none and for one that is not wanted.

        columns: the tag, or loop and signal apart. known: rows that count, None for all. Raises ForeignText where the
        columns do not hold text.
        """
        coded = []
        for column, places in zip(columns, self._places, strict=False):
            kind = column.type
            if not (pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_dictionary(kind)):
                raise ForeignText
            coded.append(codes_and_words(column))
            for word in coded[-1][1]:
                places.setdefault(word, len(places))
        local, words = coded[0]
        width = len(words)
        if len(coded) == 2:
            second, fields = coded[1]
            local = np.where((local < 0) | (second < 0), -1, local * len(fields) + second)
            width *= len(fields)
        if known is not None:
            local = np.where(known, local, -1)
        table = np.full(width + 1, -1, np.int32)
        for place in np.flatnonzero(np.bincount(local[local >= 0], minlength=width)).tolist():
            key = (words[place],) if len(coded) == 1 else (words[place // len(fields)], fields[place % len(fields)])
            code = self._codes.setdefault(key, len(self._codes))
            if code == len(self.kept):
                self.kept.append(self.wanted(".".join(key).strip()))
            table[place] = code if self.kept[code] else -1
        return table[local]

    def in_order(self) -> list[tuple[int, str]]:
        """Return (code, name) of all tags, in the order in which a table of the whole file has them."""
        places = self._places

        def place(key: tuple[str, ...]) -> tuple[int, ...]:
            return tuple(known[word] for word, known in zip(key, places, strict=False))

        return [(self._codes[key], ".".join(key)) for key in sorted(self._codes, key=place)]
