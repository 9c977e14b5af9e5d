"""backlash effects: the physical effects that models and simulations are made of."""

from __future__ import annotations

from textwrap import fill

import click


@click.command(epilog="Example: backlash effects")
@click.option("--verbose", "-v", is_flag=True, help="Also list the parameters, units, bounds and sources.")
def effects(verbose: bool) -> int:
    """List the physical effects, each in a sentence, in the order a signal meets them.

    Effects of installed packages (entry point group backlash.effects) are listed too.
    """
    from ..effects.registry import all_effects

    for effect in all_effects():
        names = ", ".join(f"{q.name} [{q.unit}]" for q in effect.parameters if not q.nuisance)
        extra = ("column, " if effect.column else "") + names
        click.echo(f"{effect.name} ({effect.stage}): {extra}")
        click.echo(fill(effect.sentence, 100, initial_indent="    ", subsequent_indent="    "))
        if verbose:
            for q in effect.parameters:
                click.echo(f"    {q.name}: {q.meaning}, {q.low:g} to {q.high:g}, neutral {q.neutral:g}")
            use = "models and simulations" if effect.fitted else "simulations only"
            click.echo(f"    For {use}. Source: {effect.source}.")
    return 0
