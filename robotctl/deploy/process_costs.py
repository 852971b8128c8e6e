"""Processor time and memory of the processes of a run, read from /proc."""

from __future__ import annotations

import os
import re
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

SIMULATOR: Final = "simulator"
_PROCESSES: Final = "robotctl.app.processes."
_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")
_PSS: Final = re.compile(r"^Pss: +(\d+) kB", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Cost:
    """Costs of all processes of a name: their share of one core, and their most memory [MiB].

    Memory is its proportional share: pages that several processes use are divided among them.
    """

    cores: float
    mib: float


class _Process(NamedTuple):
    parent: int
    used_s: float
    """Processor time so far [s]."""


class CostMeter:
    """Watches a process and all that it starts.

    Parameters
    ----------
    root
        Its number.
    proc
        Where /proc is; another folder for tests.
    """

    def __init__(self, root: int, proc: Path = Path("/proc")) -> None:
        self._root, self._proc = root, proc
        self._used_by: dict[str, dict[int, float]] = {}
        """Processor time of each process that ever was seen, by name [s]."""
        self._used: dict[str, list[tuple[float, float]]] = {}
        """Times and the processor time until then, by name [s]."""
        self._kib: dict[str, int] = {}

    def look(self, now_s: float) -> None:
        """Note what all processes have used until `now_s` [s], at any time's zero."""
        processes = dict(self._processes())
        kib: Counter[str] = Counter()
        for pid, process in processes.items():
            if not self._is_ours(pid, processes):
                continue
            with suppress(OSError, AttributeError):  # it has just ended
                rollup = (self._proc / str(pid) / "smaps_rollup").read_text()
                pss = int(_PSS.search(rollup)[1])  # type: ignore[index]
                name = self._name(pid)
                kib[name] += pss
                self._used_by.setdefault(name, {})[pid] = process.used_s
        for name in kib:
            self._kib[name] = max(kib[name], self._kib.get(name, 0))
            self._used.setdefault(name, []).append((now_s, sum(self._used_by[name].values())))

    def costs(self, seconds: float) -> dict[str, Cost]:
        """Return the costs by name, with the share of a core over the last `seconds` [s]."""
        costs = {}
        for name, used in self._used.items():
            end_s, end_used_s = used[-1]
            begin_s, begin_used_s = next(each for each in used if each[0] >= end_s - seconds)
            cores = (end_used_s - begin_used_s) / (end_s - begin_s) if end_s > begin_s else 0.0
            costs[name] = Cost(cores, self._kib[name] / 1024)
        return costs

    def _processes(self) -> list[tuple[int, _Process]]:
        """Return all processes of this computer by number; see proc_pid_stat(5)."""
        found = []
        for stat in self._proc.glob("[0-9]*/stat"):
            with suppress(OSError):
                fields = stat.read_text().rpartition(")")[2].split()
                used_s = (int(fields[11]) + int(fields[12])) / _TICKS_PER_S
                found.append((int(stat.parent.name), _Process(int(fields[1]), used_s)))
        return found

    def _is_ours(self, pid: int, processes: dict[int, _Process]) -> bool:
        """Whether a process is the watched one, or descends from it."""
        while pid != self._root and pid in processes:
            pid = processes[pid].parent
        return pid == self._root

    def _name(self, pid: int) -> str:
        """Return the name of a process of the robot by its module; of all others, the simulator."""
        words = (self._proc / str(pid) / "cmdline").read_bytes().decode(errors="replace")
        ours = (each for each in words.split("\0") if each.startswith(_PROCESSES))
        return next(ours, SIMULATOR).removeprefix(_PROCESSES)
