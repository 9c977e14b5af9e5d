"""Options that the commands on a history share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ..history.plant import PlantHistory

history_option = click.option("--history", metavar="DB", required=True, type=click.Path(path_type=Path),
                              help="History file, made by scan --history or nightly.")
limits_option = click.option("--limits", metavar="FILE", type=click.Path(path_type=Path),
                             help="Limits per class of loop (TOML). Default: the profile that comes with the tool.")
horizon_option = click.option("--horizon", metavar="DAYS", type=click.FloatRange(min=0), default=90.0,
                              show_default=True, help="Days until the next shutdown, from the last night on.")
loop_option = click.option("--loop", metavar="NAME", multiple=True, help="Only these loops; may be repeated.")


def open_plant(history: Path, limits: Path | None, loops: tuple[str, ...], horizon: float) -> PlantHistory:
    """Read the history and work out wear and ranking."""
    from ..history.limits import read_limits
    from ..history.plant import plant_history
    from ..history.store import History
    from .terminal import say

    profile = read_limits(limits)
    with History(history, say=say) as store:
        return plant_history(store, profile, loops=loops, horizon=horizon)
