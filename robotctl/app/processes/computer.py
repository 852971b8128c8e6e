"""How the robot's computer does: processor, temperature, memory, disk."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Final

from robotctl.web.wire import ComputerState

_KIB: Final = 1024


class Computer:
    """Reads the computer's own figures, as Linux gives them.

    Parameters
    ----------
    folder
        Folder on the disk that counts.
    root
        Where /proc and /sys are; another one for tests.
    """

    def __init__(self, folder: Path, root: Path = Path("/")) -> None:
        self._folder = folder
        self._stat = root / "proc/stat"
        self._meminfo = root / "proc/meminfo"
        self._zones = root / "sys/class/thermal"
        self._busy, self._all = self._times()

    def state(self) -> ComputerState:
        """Return the present figures; the processor's is that since the last call."""
        busy, total = self._times()
        spent = total - self._all
        share = (busy - self._busy) / spent if spent > 0 else None
        self._busy, self._all = busy, total
        return ComputerState(share, self._temperature_c(), *self._memory(), self._disk_free())

    def _times(self) -> tuple[int, int]:
        """Return the time that all cores were busy, and all their time [ticks]; see proc(5)."""
        try:
            times = [int(each) for each in self._stat.read_text().partition("\n")[0].split()[1:9]]
            return sum(times) - times[3] - times[4], sum(times)
        except (OSError, ValueError, IndexError):
            return 0, 0

    def _temperature_c(self) -> float | None:
        """Return the temperature of the hottest sensor [degC]; None: there is none."""
        found = []
        for zone in self._zones.glob("thermal_zone*/temp"):
            with suppress(OSError, ValueError):  # some are off
                found.append(int(zone.read_text()) / 1000.0)
        return max(found, default=None)

    def _memory(self) -> tuple[int, int]:
        """Return memory that programs can still have, and all of it [B]."""
        try:
            rows = dict(line.split(":", 1) for line in self._meminfo.read_text().splitlines())
            free, total = (int(rows[key].split()[0]) for key in ("MemAvailable", "MemTotal"))
        except (OSError, ValueError, KeyError):
            return 0, 0
        return free * _KIB, total * _KIB

    def _disk_free(self) -> int | None:
        """Return what is left on the disk [B]; None: unknown."""
        try:
            disk = os.statvfs(self._folder)
        except OSError:
            return None
        return disk.f_bavail * disk.f_frsize
