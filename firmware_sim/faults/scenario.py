"""Scenario files: faults of the simulated robot, and their times.

    seed = 3                    # of the random times; 0 if it is absent

    [[fault]]
    kind = "encoder_stuck"      # a kind of the catalogue, and its parameters
    wheel = "right"
    duration = 1.0
    at = 12.5                   # seconds after the start of the simulation

    [[fault]]
    kind = "frames_lost"
    id = 0x181
    every = 20.0                # mean pause before it begins (again) in seconds

Pauses are drawn from the exponential distribution, each from the end of the fault to its next
beginning. Every table draws from a stream of its own, so that a table added at the end changes
nothing for those before it.
"""

from __future__ import annotations

import reprlib
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from firmware_sim.config.toml_lines import Key, key_lines
from firmware_sim.errors import SimulationError, nearest
from firmware_sim.faults.catalogue import CATALOGUE, Kind
from firmware_sim.faults.fits import KIND
from firmware_sim.faults.parameters import DURATION, FAILED, Value, shown

if TYPE_CHECKING:
    from firmware_sim.config.config import RobotConfig
    from firmware_sim.faults.faults import Faults

AT, EVERY = "at", "every"
LONGEST_S: Final = 1e6
NOT_BEGUN: Final = "not begun: the run was over"


@dataclass(frozen=True, slots=True)
class PlannedFault:
    """One fault of a scenario.

    Attributes
    ----------
    kind
        A kind of the catalogue.
    arguments
        Given arguments, checked.
    at_s
        Time at which it begins [s]; None: at random.
    every_s
        Mean pause before each beginning [s]; None: once, at `at_s`.
    """

    kind: str
    arguments: Mapping[str, Value]
    at_s: float | None
    every_s: float | None

    @property
    def duration_s(self) -> float:
        """Duration [s]; 0: momentary, or until it is cleared."""
        return float(CATALOGUE[self.kind].complete(self.arguments).get(DURATION, 0.0))

    def __str__(self) -> str:
        """Return the line that injects it."""
        given = (f"{key}={_text(key, value)}" for key, value in self.arguments.items())
        return " ".join((self.kind, *given))


@dataclass(frozen=True, slots=True)
class Scenario:
    """The faults of a run and the seed of their times."""

    faults: tuple[PlannedFault, ...] = ()
    seed: int = 0


def load_scenario(path: Path, robot: RobotConfig) -> Scenario:
    """Read and check a scenario's file.

    Parameters
    ----------
    path
        The file.
    robot
        Robot of the run; the faults must fit it.

    Raises
    ------
    SimulationError
        If the file cannot be read, is invalid, or does not fit this robot; one line for each error.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        data = tomllib.loads(text)
    except (OSError, UnicodeDecodeError) as error:
        raise SimulationError(f"{path}: cannot be read: {error}") from error
    except (ValueError, RecursionError) as error:  # ValueError: also for absurdly long numbers
        raise SimulationError(f"{path}: {error}") from error
    reader = _Reader(path, key_lines(text), robot)
    scenario = reader.scenario(data)
    if reader.problems:
        raise SimulationError("\n".join(reader.problems))
    return scenario


def play(scenario: Scenario, faults: Faults, announce: Callable[[str], None]) -> None:
    """Begin the faults of a scenario at their times, which count from now.

    Parameters
    ----------
    scenario
        The planned faults.
    faults
        Faults of the simulation.
    announce
        Called for each fault as it begins: `12.500 s: encoder_stuck wheel=right duration=1`,
        followed by ` failed: ` and the reason if it could not begin.
    """
    streams = np.random.SeedSequence(scenario.seed).spawn(len(scenario.faults))
    for planned, stream in zip(scenario.faults, streams, strict=True):
        _Player(planned, faults, announce, np.random.default_rng(stream)).start()


def not_begun(scenario: Scenario, announced: Iterable[str]) -> list[str]:
    """Return a line for each fault whose `at` had not come when a run was over.

    The lines have the form in which `play` announces a failure. Faults with `every` may never
    begin.

    Parameters
    ----------
    scenario
        Planned faults.
    announced
        All lines that `play` has announced.
    """
    begun = {line.partition(FAILED)[0] for line in announced}
    due = [_line(each.at_s, each) for each in scenario.faults if each.at_s is not None]
    return [f"{line}{FAILED}{NOT_BEGUN}" for line in due if line not in begun]


class _Player:
    """One fault of a scenario in a run."""

    def __init__(
        self,
        planned: PlannedFault,
        faults: Faults,
        announce: Callable[[str], None],
        rng: np.random.Generator,
    ) -> None:
        self._planned = planned
        self._faults = faults
        self._announce = announce
        self._rng = rng
        self._bus = faults.robot.bus
        self._start_ns = self._bus.now_ns

    def start(self) -> None:
        """Wait for the first time."""
        planned = self._planned
        self._wait(self._pause_s() if planned.at_s is None else planned.at_s)

    def _pause_s(self) -> float:
        return float(self._rng.exponential(self._planned.every_s or 0.0))

    def _wait(self, pause_s: float) -> None:
        self._bus.schedule(self._bus.now_ns + _nanoseconds(pause_s), self._begin)

    def _begin(self) -> None:
        planned = self._planned
        line = _line((self._bus.now_ns - self._start_ns) / 1e9, planned)
        try:
            self._faults.begin(planned.kind, planned.arguments)
        except SimulationError as error:
            line += f"{FAILED}{error}"
        self._announce(line)
        if planned.every_s is not None:
            self._wait(planned.duration_s + self._pause_s())


class _Reader:
    """Turns the tables of one file into values and collects their errors."""

    def __init__(self, path: Path, lines: Mapping[Key, int], robot: RobotConfig) -> None:
        self._path = path
        self._lines = lines
        self._robot = robot
        self.problems: list[str] = []

    def scenario(self, data: Mapping[str, Any]) -> Scenario:
        """Return the scenario of the file."""
        for key in data:
            if key not in ("seed", "fault"):
                self._blame((key,), f"unknown key{nearest(key, ('seed', 'fault'))}")
        seed = data.get("seed", 0)
        if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
            self._blame(("seed",), f"{reprlib.repr(seed)} is no whole number from 0 on")
            seed = 0
        tables = data.get("fault", [])
        if not isinstance(tables, list) or not all(isinstance(each, dict) for each in tables):
            self._blame(("fault",), "write each fault as a table [[fault]]")
            tables = []
        faults = [self._fault(("fault", index), table) for index, table in enumerate(tables)]
        return Scenario(tuple(each for each in faults if each is not None), seed)

    def _fault(self, where: Key, table: Mapping[str, Any]) -> PlannedFault | None:
        name = table.get(KIND)
        if name is None:
            self._blame(where, 'a fault needs its kind, as kind = "bus_cut"')
            return None
        kind = CATALOGUE.get(name) if isinstance(name, str) else None
        if kind is None:
            hint = nearest(str(name), CATALOGUE) or f"; allowed: {', '.join(CATALOGUE)}"
            self._blame((*where, KIND), f"{reprlib.repr(name)} is no kind of fault{hint}")
            return None
        arguments = self._arguments(where, kind, table)
        for key, problem in kind.fits(self._robot, kind.complete(arguments)):
            self._blame((*where, key), problem)
        at_s, every_s = (self._time(where, table, key) for key in (AT, EVERY))
        if (AT in table) == (EVERY in table):
            self._blame(where, f"needs either {AT} or {EVERY}, the time in seconds")
        planned = PlannedFault(name, arguments, at_s, every_s)
        if every_s is not None and DURATION in kind.parameters and planned.duration_s <= 0.0:
            self._blame((*where, DURATION), f"must be greater than 0 with {EVERY}")
        return planned

    def _arguments(self, where: Key, kind: Kind, table: Mapping[str, Any]) -> dict[str, Value]:
        arguments = {}
        for key, given in table.items():
            if key in (KIND, AT, EVERY):
                continue
            try:
                arguments[key] = kind.value(key, given)
            except SimulationError as error:
                self._blame((*where, key), str(error).removeprefix(f"{shown(key)}: "))
        return arguments

    def _time(self, where: Key, table: Mapping[str, Any], key: str) -> float | None:
        given = table.get(key)
        if given is None:
            return None
        is_number = isinstance(given, int | float) and not isinstance(given, bool)
        lowest = 0.001 if key == EVERY else 0.0
        if not is_number or not lowest <= given <= LONGEST_S:
            self._blame(
                (*where, key), f"{reprlib.repr(given)}, allowed: {lowest:g} to {LONGEST_S:g} s"
            )
            return None
        return float(given)

    def _blame(self, key: Key, problem: str) -> None:
        line = self._line(key)
        place = f"{self._path}:{line}" if line else str(self._path)
        self.problems.append(f"{place}: {_dotted(key)}: {problem}")

    def _line(self, key: Key) -> int | None:
        """Return the line of a key, or of its nearest parent, or of its first child."""
        around = (key[:length] for length in range(len(key), 0, -1))
        lines = [self._lines[each] for each in around if each in self._lines]
        lines += sorted(line for each, line in self._lines.items() if each[: len(key)] == key)
        return next(iter(lines), None)


def _line(time_s: float, planned: PlannedFault) -> str:
    """Return the message about a fault that begins."""
    return f"{_nanoseconds(time_s) / 1e9:.3f} s: {planned}"


def _nanoseconds(time_s: float) -> int:
    return round(time_s * 1e9)


def _text(key: str, value: Value) -> str:
    if isinstance(value, str):
        return value
    return f"{int(value):#x}" if key == "id" else f"{value:g}"


def _dotted(key: Key) -> str:
    """Return a key as shown in messages: `fault[0].kind`."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{shown(part)}" for part in key)
    return text.removeprefix(".")
