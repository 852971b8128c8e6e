"""The navigation process with a leak built in: from a signal on it takes all memory it can have."""

from __future__ import annotations

import resource
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Any

from robotctl.app.processes import navigation
from robotctl.app.processes.entry import enter

LEAK = signal.SIGRTMIN
_ROOM_BYTES = 64 * 2**20
PIECE_BYTES = 16 * 2**20


def limit_memory() -> None:
    """Leave so much memory to this process and no more, as the machine would."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * resource.getpagesize() + _ROOM_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def main() -> int:
    """Run the navigation process until SIGTERM, or until it has no memory left."""
    leaking = False

    class LeakingTick(navigation.NavigationTick):
        leaked: list[bytearray]

        def navigate(self, *arguments: Any) -> Any:
            if leaking:
                if not hasattr(self, "leaked"):
                    self.leaked = []
                    limit_memory()
                self.leaked.append(bytearray(PIECE_BYTES))
            return super().navigate(*arguments)

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        nonlocal leaking
        leaking = True

    signal.signal(LEAK, on_signal)
    navigation.NavigationTick = LeakingTick  # type: ignore[misc]
    return enter("navigation", navigation.run)


if __name__ == "__main__":
    sys.exit(main())
