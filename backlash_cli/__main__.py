"""Entry point: a group of commands, each loaded only when it is called, so that `--help` answers at once."""

from __future__ import annotations

import importlib
import pkgutil
import sys
from typing import Any

import click

from . import commands
from ._version import __version__
from .errors import BacklashError

SUMMARIES = {
    "scan": "Find dead band in every loop of an export.",
    "check": "Check data quality and controller settings of every loop.",
    "compare": "Compare a model of a loop with its measurements and see where it fails.",
    "explain": "Find the physical effects that are missing in a loop's model.",
    "effects": "List the physical effects, each in a sentence.",
    "simulate": "Write a record from the closed-loop simulator.",
    "compensate": "Simulate a loop with and without backlash compensation.",
    "paper": "Recompute the numbers of Haegglund (2007), paper against ours.",
    "history": "List, export and mark repairs in the history of nightly scans.",
    "trend": "Show how dead bands grow from night to night.",
    "report": "Write the report page of a history.",
    "nightly": "Run the nightly job of a configuration file.",
}


class LazyGroup(click.Group):
    """Finds commands by file name and imports one only when it runs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        found = {m.name for m in pkgutil.iter_modules(commands.__path__)}
        return [name for name in SUMMARIES if name in found]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in self.list_commands(ctx):
            return None
        return getattr(importlib.import_module(f"backlash_cli.commands.{name}"), name)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        from .errors import nearest

        if args and not args[0].startswith("-") and args[0] not in self.list_commands(ctx):
            raise click.UsageError(f"no command '{args[0]}': {nearest(args[0], self.list_commands(ctx))}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        rows = [(name, SUMMARIES[name]) for name in self.list_commands(ctx)]
        if rows:
            with formatter.section("Commands"):
                formatter.write_dl(rows)


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Example: backlash scan sample_data/plant.csv",
)
@click.version_option(__version__, prog_name="backlash")
def cli() -> None:
    """Find play (dead band) in control valves from historian exports."""


def main() -> None:
    """Run the command line; every failure becomes one message and an exit status of the contract."""
    try:
        code = cli.main(standalone_mode=False)
        sys.stdout.flush()
    except BacklashError as error:
        click.echo(f"backlash: error: {error}", err=True)
        code = 2
    except click.ClickException as error:
        error.show()
        code = 2
    except (click.Abort, KeyboardInterrupt):
        click.echo("backlash: stopped by the user; nothing was left half written", err=True)
        code = 130
    except BrokenPipeError:
        sys.stderr.close()
        code = 0
    sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
