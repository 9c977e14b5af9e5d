"""Entry point: the commands as one group; every failure becomes one message and an exit status of the contract."""

from __future__ import annotations

import errno
import os
import signal
import sys
import threading
import time
import warnings
from typing import Any

import click

from ._version import __version__
from .commands.check import check
from .commands.history import history, report, trend
from .commands.nightly import nightly
from .commands.scan import scan
from .commands.simulate import compensate, effects, paper, plan, simulate
from .commands.terminal import say
from .commands.workbench import compare, explain
from .errors import BacklashError, nearest

# matrices here are tall and narrow: threads of the linear algebra library cost more than they gain
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")


class Commands(click.Group):
    """The commands in the order in which a user meets them; a wrong name brings up the nearest."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if args and not args[0].startswith("-") and args[0] not in self.commands:
            raise click.UsageError(f"no command '{args[0]}': {nearest(args[0], self.commands)}", ctx)
        return super().resolve_command(ctx, args)


@click.group(
    cls=Commands, epilog="Example: backlash scan sample_data/plant.csv",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    commands=[scan, plan, check, compare, explain, effects, simulate, compensate, paper, history, trend, report,
              nightly])
@click.version_option(__version__, prog_name="backlash")
def cli() -> None:
    """Find play (dead band) in control valves from historian exports."""


STOPS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
PATIENCE = 8.0  # seconds that an orderly end may take after a stop
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EIO)  # without a file's name: standard output, whose disk is full or gone
NOT_WRITTEN = "error: standard output: cannot write: {} -> write to another place"


def main() -> None:
    """Run the command line; every failure becomes one message and an exit status of the contract."""
    for number in STOPS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _stop)
    _see_to_the_end()
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # remarks of libraries to programmers; ours are in the report
    code = _guarded(sys.argv[1:])
    if code > 128:
        # Stopped from outside: libraries may still be at work in threads of their own, which do not all survive
        # an orderly end of the interpreter. Everything of ours is cleaned up by now.
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _guarded(arguments: list[str]) -> int:
    code, words = 2, ""
    try:
        code = _run(arguments)
    except BacklashError as error:
        words = f"error: {error}"
    except click.ClickException as error:
        error.show()
    except KeyboardInterrupt as stop:
        words = "; ".join(["stopped", *getattr(stop, "__notes__", []), "nothing was left half written"])
        code = 128 + (_asked_to_end[0] if _asked_to_end else signal.SIGINT)
    except BrokenPipeError:
        code = 0  # the reader of our output has gone (`| head`): say nothing
    except MemoryError:
        words = "error: not enough memory -> give fewer files, or fewer loops with --loop"
    except Exception as error:
        if isinstance(error, OSError) and error.filename is None and error.errno in FULL:
            words = NOT_WRITTEN.format(error.strerror)
        elif os.environ.get("BACKLASH_DEBUG"):
            raise
        else:
            words = (f"error: unexpected {type(error).__name__}: {error} -> this is a fault of backlash; "
                     "BACKLASH_DEBUG=1 shows where it happened")
    try:
        sys.stdout.flush()
    except OSError as error:
        # keep it from the exit of Python, which would print its own complaint and change the exit status
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError) and not words:
            code, words = 2, NOT_WRITTEN.format(error.strerror)
    if words:
        say(words)
    return code


def _run(arguments: list[str]) -> int:
    """Run one command and return its exit status; click's own entry would answer Ctrl-C and closed pipes its way."""
    if "_BACKLASH_COMPLETE" in os.environ:
        cli.main(arguments, prog_name="backlash")
    try:
        with cli.make_context("backlash", arguments) as context:
            return cli.invoke(context) or 0
    except click.exceptions.Exit as done:
        return done.exit_code
    except Exception as error:
        if _asked_to_end:  # a library, in the middle of its import for one, answered the stop with an error of its own
            raise KeyboardInterrupt from error
        raise


_asked_to_end: list[int] = []  # signals that came (Ctrl-C, SIGTERM, or the terminal was closed)


def _stop(number: int, frame: object) -> None:
    _asked_to_end.append(number)
    raise KeyboardInterrupt


def _see_to_the_end() -> None:
    """End the process where a stop is lost on its way: an exception that lands inside an import or a callback of a
    library may be swallowed there, or leave a lock closed for ever."""
    told, tell = os.pipe()
    os.set_blocking(tell, False)
    signal.set_wakeup_fd(tell, warn_on_full_buffer=False)  # a byte for each signal, whatever Python is doing

    def wait() -> None:
        while (number := os.read(told, 1)[0]) not in STOPS:
            pass
        time.sleep(PATIENCE)
        os.write(2, b"backlash: stopped; nothing was left half written\n")
        os._exit(128 + number)

    threading.Thread(target=wait, daemon=True).start()


if __name__ == "__main__":
    main()
