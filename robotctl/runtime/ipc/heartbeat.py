"""Heartbeats: a counter in shared memory by which a supervisor sees that a process makes progress.

The memory is anonymous (memfd) and goes to the child as an inherited descriptor: nothing is left
behind, no socket or file system is on the way, and a beat costs the control loop under 1 us.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Mapping
from typing import Final

VARIABLE: Final = "ROBOTCTL_HEARTBEAT"
"""Environment variable with the number of the inherited descriptor."""

_COUNT = struct.Struct("=Q")


class ProcessHeartbeat:
    """The sender, in the supervised process. Without a supervisor nothing reads it.

    Parameters
    ----------
    environment
        Environment whose `VARIABLE` may name the descriptor, usually `os.environ`.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        descriptor = environment.get(VARIABLE)
        self._count = 0
        self._memory = mmap.mmap(-1 if descriptor is None else int(descriptor), _COUNT.size)

    def beat(self) -> None:
        """Count one more round of work."""
        self._count += 1
        _COUNT.pack_into(self._memory, 0, self._count)


class HeartbeatMonitor:
    """The receiver, in the supervisor: one for each start of a process.

    Attributes
    ----------
    descriptor
        Descriptor that the process inherits, with its number in `VARIABLE`.
    """

    def __init__(self) -> None:
        self.descriptor = os.memfd_create("heartbeat", os.MFD_CLOEXEC)
        os.ftruncate(self.descriptor, _COUNT.size)
        self._memory = mmap.mmap(self.descriptor, _COUNT.size, prot=mmap.PROT_READ)

    def count(self) -> int:
        """Return the number of beats of the process."""
        return int(_COUNT.unpack_from(self._memory)[0])

    def close(self) -> None:
        """Release the memory."""
        self._memory.close()
        os.close(self.descriptor)
