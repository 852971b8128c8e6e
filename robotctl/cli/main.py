"""The `robotctl` command: errors and Ctrl-C without tracebacks."""

from __future__ import annotations

import sys

from robotctl.errors import RobotctlError

BAD_INPUT = 2
INTERRUPTED = 130


def main() -> None:
    """Run the command line; a known error, or a file that is refused, ends it with status 2."""
    try:
        # It takes a second or more, in which Ctrl-C may come.
        from robotctl.cli.commands import app  # noqa: PLC0415

        app()
    except RobotctlError as error:
        print(f"robotctl: {error}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except OSError as error:
        if error.filename is None:
            raise
        print(f"robotctl: {error.filename}: {error.strerror}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
