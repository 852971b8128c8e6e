"""`robotctl` with the arguments of a test."""

from __future__ import annotations

import pytest

from robotctl.cli import main as command_line


def status_of(*arguments: object) -> int:
    """Run `robotctl ARGUMENTS` in this process and return its exit status."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["robotctl", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            command_line.main()
    return int(ended.value.code or 0)
