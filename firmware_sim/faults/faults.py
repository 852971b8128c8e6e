"""Faults of the simulated robot, each set off by one line: `encoder_stuck wheel=left duration=0.5`.

The kinds stand in `fault_catalogue`. A lasting fault ends after its `duration`, or by `clear`;
faults of the bus end only by themselves.
"""

from __future__ import annotations

import reprlib
from functools import partial

from firmware_sim.errors import SimulationError
from firmware_sim.faults.catalogue import CATALOGUE, Kind
from firmware_sim.faults.faulty_robot import FaultyRobot
from firmware_sim.faults.parameters import DURATION, Arguments, Undo, Value, nearest, shown

CLEAR = "clear"


class Faults:
    """The faults of one simulation.

    Parameters
    ----------
    robot
        Whom they befall.

    Attributes
    ----------
    robot
        Whom they befall.
    stage
        Inputs of its drive.
    """

    def __init__(self, robot: FaultyRobot) -> None:
        self.robot = robot
        self.stage = robot.stage
        self._present: list[Undo] = []

    def inject(self, line: str) -> str:
        """Let one fault begin now; return its kind. `clear` ends all that last.

        Raises
        ------
        SimulationError
            If the line is wrong.
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
        """Let a fault begin now; raises SimulationError if it is wrong, or not of this robot."""
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
        """End all faults that last; those of the bus end by themselves."""
        for undo in list(self._present):
            self._finish(undo)

    def _finish(self, undo: Undo) -> None:
        if undo in self._present:
            self._present.remove(undo)
            self.robot.catch_up()
            undo()


def check(name: str, given: Arguments) -> tuple[Kind, dict[str, Value]]:
    """Return a kind of fault and its arguments, defaults filled in, numbers as numbers.

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
