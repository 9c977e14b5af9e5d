"""Entry point: the commands as one group; every failure becomes one message and an exit status of the contract."""

import errno
import os
import shutil
import signal
import sys
import threading
import time
import warnings
from functools import partial
from typing import Any

import click

from ._version import __version__
from .commands.options import PAGE, command
from .commands.terminal import say
from .errors import BacklashError, nearest
from .reporter.safe import ASKED

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
        ctx.call_on_close(partial(ASKED.reset, ASKED.set(tuple(args))))
        return super().resolve_command(ctx, args)


@click.group(cls=Commands, epilog="Example: backlash scan sample_data/plant.csv", context_settings={
    "help_option_names": ["-h", "--help"], "max_content_width": 100}, commands=[
        command(name) for name, words in PAGE.items() if "module" in words])
@click.version_option(__version__, prog_name="backlash")
def cli() -> None:
    """Find play (dead band) in control valves from historian exports."""


STOPS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
PATIENCE = 8.0  # seconds that an orderly end may take after a stop
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EIO)  # without a file's name: standard output, whose disk is full or gone
NOT_WRITTEN = "error: standard output: cannot write: {} -> write to another place with --output"


def main() -> None:
    """Run the command line; every failure becomes one message and an exit status of the contract."""
    for stream in ("stdout", "stderr"):
        if getattr(sys, stream) is None:  # closed by who started us: nobody listens
            setattr(sys, stream, open(os.devnull, "w"))  # noqa: SIM115
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # remarks of libraries to programmers; ours are in the report
    code = _guarded(sys.argv[1:])
    if code > 128:
        # Stopped from outside: libraries may still be at work in threads of their own, which do not all survive
        # an orderly end of the interpreter. Everything of ours is cleaned up by now but the socket of our processes.
        from multiprocessing.util import get_temp_dir

        shutil.rmtree(get_temp_dir(), ignore_errors=True)
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _guarded(arguments: list[str]) -> int:
    """Run one command and return its exit status; click's own entry would answer Ctrl-C and closed pipes its way."""
    code, words = 2, ""
    try:
        _hear_stops()
        if "_BACKLASH_COMPLETE" in os.environ:
            cli.main(arguments, prog_name="backlash")
        with cli.make_context("backlash", arguments) as context:
            code = cli.invoke(context) or 0
    except click.exceptions.Exit as done:
        code = done.exit_code
    except (Exception, KeyboardInterrupt) as error:
        # a library, in the middle of its import for one, may answer a stop with an error of its own
        if _asked_to_end or isinstance(error, KeyboardInterrupt):
            words = "; ".join(["stopped", *getattr(error, "__notes__", []), "nothing was left half written"])
            code = 128 + (_asked_to_end[0] if _asked_to_end else signal.SIGINT)
        elif isinstance(error, BacklashError):
            words = f"error: {error}"
        elif isinstance(error, click.ClickException):
            error.show()
        elif isinstance(error, BrokenPipeError):
            code = 0  # the reader of our output has gone (`| head`): say nothing
        elif isinstance(error, MemoryError):
            words = "error: not enough memory -> give fewer files, or fewer loops with --loop"
        elif isinstance(error, OSError) and error.filename is None and error.errno in FULL:
            words = NOT_WRITTEN.format(error.strerror)
        elif os.environ.get("BACKLASH_DEBUG"):
            raise
        else:
            words = (f"error: unexpected {type(error).__name__}: {error} -> this is a fault of backlash; "
                     "BACKLASH_DEBUG=1 shows where it happened")
    for number in STOPS:
        if signal.getsignal(number) is _stop:
            signal.signal(number, signal.SIG_DFL)  # all is said and done: there is nothing left to end in order
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


_asked_to_end: list[int] = []  # signals that came (Ctrl-C, SIGTERM, or the terminal was closed)


def _stop(number: int, frame: object) -> None:
    _asked_to_end.append(number)
    raise KeyboardInterrupt


def _hear_stops() -> None:
    """Let a stop raise, and end the process where that is lost on its way: an exception that lands inside an import or
    a callback of a library may be swallowed there, or leave a lock closed for ever."""
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
    for number in STOPS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _stop)


if __name__ == "__main__":
    main()
