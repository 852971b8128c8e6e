"""Faults of the simulated robot, each started by one line: `encoder_stuck wheel=left duration=0.5`.

The kinds are in `catalogue.CATALOGUE`. A lasting fault ends after its `duration`, or by `clear`;
`clear` does not end faults of the bus.
"""

from __future__ import annotations

import reprlib
from functools import partial

from firmware_sim.errors import SimulationError, nearest
from firmware_sim.faults.catalogue import CATALOGUE, Kind
from firmware_sim.faults.faulty_robot import FaultyRobot
from firmware_sim.faults.parameters import DURATION, Arguments, Undo, Value, shown

CLEAR = "clear"


class Faults:
    """The faults of one simulation.

    Parameters
    ----------
    robot
        Robot that has the faults.

    Attributes
    ----------
    robot
        Robot that has the faults.
    stage
        Power stage with the faults of its drives.
    """

    def __init__(self, robot: FaultyRobot) -> None:
        self.robot = robot
        self.stage = robot.stage
        self._present: list[Undo] = []

    def inject(self, line: str) -> str:
        """Begin one fault now; return its kind. `clear` ends all that last.

        Raises
        ------
        SimulationError
            If the line is invalid.
        """
        name, *words = line.split() or [""]
        if name == CLEAR and not words:
            self.clear()
            return name
        arguments: dict[str, Value] = {}
        for word in words:
            key, equals, value = word.partition("=")
            if not equals:
                raise SimulationError(
                    f"fault {shown(name)}: {reprlib.repr(word)} is not of the form key=value"
                )
            if key in arguments:
                raise SimulationError(f"fault {shown(name)}: {shown(key)} is given twice")
            arguments[key] = value
        self.begin(name, arguments)
        return name

    def begin(self, name: str, given: Arguments) -> None:
        """Begin a fault now; raises SimulationError if it is invalid or does not fit the robot."""
        kind, arguments = check(name, given)
        misfits = [
            f"fault {name}: {key}: {problem}"
            for key, problem in kind.fits(self.robot.config, arguments)
        ]
        if misfits:
            raise SimulationError("; ".join(misfits))
        self.robot.catch_up()
        undo = kind.begin(self.robot, arguments)
        if undo is None:
            return
        self._present.append(undo)
        duration_s = float(arguments[DURATION])
        if duration_s > 0.0:
            bus = self.robot.bus
            bus.schedule(bus.now_ns + round(duration_s * 1e9), partial(self._finish, undo))

    def clear(self) -> None:
        """End all faults that last, but those of the bus."""
        for undo in list(self._present):
            self._finish(undo)

    def _finish(self, undo: Undo) -> None:
        if undo in self._present:
            self._present.remove(undo)
            self.robot.catch_up()
            undo()


def check(name: str, given: Arguments) -> tuple[Kind, dict[str, Value]]:
    """Return a kind of fault and its arguments with defaults, text converted to numbers.

    Raises
    ------
    SimulationError
        If the kind or an argument is unknown, or a value is not allowed.
    """
    kind = CATALOGUE.get(name)
    if kind is None:
        kinds = [*CATALOGUE, CLEAR]
        hint = nearest(name.lower(), kinds) or f", allowed: {', '.join(kinds)}"
        raise SimulationError(f"fault {reprlib.repr(name)}: unknown{hint}")
    try:
        checked = {key: kind.value(key, value) for key, value in given.items()}
    except SimulationError as error:
        raise SimulationError(f"fault {name}: {error}") from None
    return kind, kind.complete(checked)
