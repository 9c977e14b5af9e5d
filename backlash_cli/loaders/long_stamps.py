"""The stamps of a long file, block by block: kept as they come, understood when the last one is known.

Whatever the kind of stamps, a row keeps 64 bits of it. What these mean is settled at the end, from all that was seen,
exactly as `time_axis` does with the columns of the whole file; where that cannot be done, ForeignText is raised and the
file has to be read whole.
"""

from __future__ import annotations

from collections.abc import Sequence

import pyarrow as pa

from .csv_signal import ForeignText
from .minutes import is_written
from .options import ReadOptions
from .row_stamps import NumberStamps, Stamps, counts_from_1970
from .stamp_words import year_first
from .tables import Table
from .text_stamps import WrittenStamps


def stamps_for(head: Table, columns: Sequence[int], options: ReadOptions) -> Stamps:
    """Return what takes the stamps of some columns, one or those of date and time of day; head: the first rows.

    Raises ForeignText for stamps that must be seen as a whole.
    """
    names = [head.names[i] for i in columns]
    first = head.columns[columns[0]]
    kind = first.type
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    parts = len(columns) > 1
    if pa.types.is_timestamp(kind) or (parts and pa.types.is_date(kind)):
        return Stamps(names, options, head.where, pa.types.is_timestamp(kind) and kind.tz is not None and not parts)
    if is_written(kind):
        try:
            zoned = year_first(first, names[0], options, head.where).zoned
            return Stamps(names, options, head.where, zoned and not parts)
        except ForeignText:
            pass
        if not parts and counts_from_1970(first, names[0], options):
            return NumberStamps(names, options, head.where, False)
        return WrittenStamps(names, options, head.where, False)
    if not parts and (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
        return NumberStamps(names, options, head.where, False)
    raise ForeignText
