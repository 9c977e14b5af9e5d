"""A process that writes is killed, again and again; each is forked from one that has imported everything."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from textwrap import indent

CODE = """
import os, sys
{begin}
while sys.stdin.readline():
    if not (child := os.fork()):
{work}
        os._exit(0)
    os.waitpid(child, 0)
    print(flush=True)
"""
TELL = "print(os.getpid(), flush=True)\n"


def killed(begin: str, work: str, argument: object, delays: Iterable[float]) -> Iterator[None]:
    """Yield after every kill. begin: code that runs once; work: what is killed a delay [s] after it has run TELL."""
    code = CODE.format(begin=begin, work=indent(work, " " * 8))
    command = [sys.executable, "-c", code, str(argument)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as first:
        assert first.stdin and first.stdout
        for delay in delays:
            print(file=first.stdin, flush=True)
            number = int(first.stdout.readline())
            time.sleep(delay)
            with contextlib.suppress(ProcessLookupError):  # it had finished
                os.kill(number, signal.SIGKILL)
            first.stdout.readline()
            yield
