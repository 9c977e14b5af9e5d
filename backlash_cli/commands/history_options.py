"""Options that the commands on a history share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ..history.limits import Limits
    from ..history.plant import PlantHistory

history_option = click.option("--history", metavar="DB", required=True, type=click.Path(path_type=Path),
                              help="History file, made by scan --history or nightly.")
limits_option = click.option("--limits", metavar="FILE", type=click.Path(path_type=Path),
                             help="Limits per class of loop (TOML). Default: the profile that comes with the tool.")
settings_option = click.option("--loops", "settings", metavar="FILE", type=click.Path(path_type=Path),
                               help="Loop settings; a key limit_class names the class of a loop's limit.")
horizon_option = click.option("--horizon", metavar="DAYS", type=click.FloatRange(min=0), default=90.0,
                              show_default=True, help="Days until the next shutdown, from the last night on.")
loop_option = click.option("--loop", metavar="NAME", multiple=True, help="Only these loops; may be repeated.")


def read_profile(limits: Path | None, loops: Path | None) -> Limits:
    """Read the limits profile; classes that a loops file names (`limit_class`) go before patterns."""
    from ..history.limits import read_limits

    profile = read_limits(limits)
    if loops is None:
        return profile
    from ..loaders.sources import read_metadata

    metadata = read_metadata(loops)
    chosen = {name: str(v.values["limit_class"]) for name, v in metadata.loops.items()
              if "limit_class" in v.values and "limit_class" not in v.from_defaults}
    default = metadata.defaults.get("limit_class")
    return profile.with_classes(chosen, None if default is None else str(default), str(loops))


def open_plant(history: Path, limits: Path | None, settings: Path | None, loops: tuple[str, ...],
               horizon: float) -> PlantHistory:
    """Read the history and work out wear and ranking. settings: loops file with limit classes."""
    from ..history.plant import plant_history
    from ..history.store import History
    from .terminal import say

    profile = read_profile(limits, settings)
    with History(history, say=say) as store:
        return plant_history(store, profile, loops=loops, horizon=horizon)
