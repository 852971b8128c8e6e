"""The `robotctl` command: errors and Ctrl-C without tracebacks."""

from __future__ import annotations

import errno
import signal
import sys
from typing import Final

from robotctl.app.supervision.signals import hold_emergency_signal, name_process
from robotctl.cli.output import quiet_output
from robotctl.errors import DISK, DiskError, RobotctlError

BAD_INPUT = 2
NOT_WRITTEN = 4
INTERRUPTED = 130

_ONLY_PRINTED: Final = ({"--help"}, {"version"}, {"config", "show"}, {"config", "schema"})
"""Words of commands that do nothing but print."""


def main() -> None:
    """Run the command line; a known error, or a file that is refused, ends it with status 2.

    A disk that is full or fails is no bad input: status 4. Printing errors change neither the files
    of a run nor its status: a character that the encoding has not is written plainly, and where the
    standard output is full or nobody reads it, the rest is dropped. A full one is said, and is an
    error of a command that only prints.
    """
    hold_emergency_signal()
    name_process()
    with quiet_output() as output:
        status = _status()
        if status == INTERRUPTED:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # some press Ctrl-C more than once
            _say("interrupted")
        output.flush()
        if output.failure is not None and output.failure.errno != errno.EPIPE:
            _say(f"standard output: {output.failure.strerror}")
            if any(words <= set(sys.argv) for words in _ONLY_PRINTED):
                status = status or BAD_INPUT
    sys.exit(status)


def _status() -> int | str | None:
    """Run the command line and return the status to end with."""
    try:
        # It takes a moment, in which Ctrl-C may come.
        from robotctl.cli.commands import app  # noqa: PLC0415

        app()
    except SystemExit as ended:
        return ended.code
    except DiskError as error:
        _say(str(error))
        return NOT_WRITTEN
    except RobotctlError as error:
        _say(str(error))
        return BAD_INPUT
    except OSError as error:
        if error.filename is None and error.errno not in DISK:
            raise
        place = "" if error.filename is None else f"{error.filename}: "
        _say(f"{place}{error.strerror}")
        return NOT_WRITTEN if error.errno in DISK else BAD_INPUT
    except KeyboardInterrupt:
        return INTERRUPTED
    return 0


def _say(what: str) -> None:
    """Print a sentence to the standard error, below what was printed before."""
    sys.stdout.flush()
    print(f"robotctl: {what}", file=sys.stderr)


if __name__ == "__main__":
    main()
