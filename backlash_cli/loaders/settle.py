"""Which loops a plant has, under which names, and which of them are wanted; needs names and tags, no samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import InputError
from ..record import Note
from .join import LoopSeries, by_loop
from .metadata import ROLE_KEYS, Metadata
from .options import ReadOptions
from .selection import choose
from .series import Series

FEW_LOOPS = 3  # loops of the loops file without data that are named one by one


@dataclass(frozen=True)
class Settled:
    """loops: those that are wanted, by name, in order. notes: what was left out. unmatched: loops without data."""

    loops: dict[str, LoopSeries]
    notes: tuple[Note, ...] = ()
    unmatched: tuple[Note, ...] = ()


def settle(found: Sequence[Series], metadata: Metadata, options: ReadOptions, where: str) -> Settled:
    """Return the loops of all signals of a plant that the options ask for.

    Raises InputError when no signal belongs to a loop, UsageError when no loop is what the options ask for.
    """
    series = by_loop(found, metadata)
    if not series:
        tags = sorted({item.tag for item in found})
        shown = ", ".join(filter(None, tags[:12])) or "columns without a name"
        raise InputError(
            "no loop found: no column is called SP, PV or OP of a loop", where=where,
            remedy=f"name the tags in loops.toml; found: {shown}",
        )
    series, notes = _loops_only(series, metadata)
    choice = choose(series, options.only_loops, options.loops_matching, options.sample, options.sample_seed)
    wanted = {name: series[name] for name in choice.names}
    return Settled(wanted, (*notes, *choice.notes), tuple(_unmatched(series, metadata)))


def _loops_only(series: dict[str, LoopSeries], metadata: Metadata) -> tuple[dict[str, LoopSeries], list[Note]]:
    """Set aside what has one signal only and is not in the metadata: an indicator, or a column with a chance name."""
    single = [name for name, own in series.items() if len(own.roles) == 1 and metadata.of(name) is None]
    if not single or len(single) == len(series):
        return series, []
    shown = ", ".join(name[:40] for name in sorted(single)[:5]) + (", ..." if len(single) > 5 else "")
    text = f"{len(single)} tags have one signal only and are no loops; they are left out: {shown}"
    return {name: own for name, own in series.items() if name not in set(single)}, [Note("single_signals", text)]


def _unmatched(series: dict[str, LoopSeries], metadata: Metadata) -> list[Note]:
    from ..errors import nearest

    used = {metadata.match(name) for name in series}
    missing = {name: own for name, own in metadata.loops.items() if name not in used}
    if len(missing) > FEW_LOOPS:
        # The loops file of a whole plant beside the export of a few loops: usual, and one line says it.
        shown = ", ".join(list(missing)[:FEW_LOOPS])
        text = f"{len(missing)} loops of the loops file are not found in the data: {shown} ..."
        return [Note("loop_not_found", text, {"loop": ", ".join(missing), "loops": len(missing)})]
    notes = []
    for name, own in missing.items():
        tags = ", ".join(tag for role in ROLE_KEYS if isinstance(tag := own.values.get(role), str))
        hint = f"its tags {tags} are not there" if tags else nearest(name, sorted(series))
        text = f"loop {name} of the loops file is not found in the data ({hint})"
        notes.append(Note("loop_not_found", text, {"loop": name}))
    return notes
