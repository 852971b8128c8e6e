"""The `robotctl` command: errors and Ctrl-C without tracebacks."""

from __future__ import annotations

import errno
import os
import sys
from io import TextIOWrapper
from typing import Final

from robotctl.errors import RobotctlError

BAD_INPUT = 2
NOBODY_READS = 1
INTERRUPTED = 130

_DISK: Final = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}
"""What a disk says that cannot take or give any more; where it says so there is no file name."""


def main() -> None:
    """Run the command line; a known error, or a file that is refused, ends it with status 2.

    So does a disk that cannot take what is written, the standard output included. Names of files
    are printed as they are, in whatever encoding. Where the standard output is closed, nobody wants
    what would be printed.
    """
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115, PTH123 - until the process ends
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")
    try:
        _run()
    except RobotctlError as error:
        give_up_output()
        print(f"robotctl: {error}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except OSError as error:
        give_up_output()
        if error.errno == errno.EPIPE and error.filename is None:
            sys.exit(NOBODY_READS)
        if error.filename is None and error.errno not in _DISK:
            raise
        place = "" if error.filename is None else f"{error.filename}: "
        print(f"robotctl: {place}{error.strerror}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


def _run() -> None:
    """Run the command line until all its output is written."""
    # It takes a second or more, in which Ctrl-C may come.
    from robotctl.cli.commands import app  # noqa: PLC0415

    try:
        app()
    except SystemExit:
        sys.stdout.flush()
        raise


def give_up_output() -> None:
    """Write the rest of the output, or drop it: the interpreter would try it again at its end."""
    try:
        sys.stdout.flush()
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


if __name__ == "__main__":
    main()
