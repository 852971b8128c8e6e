"""Faults of the simulated robot, each set off by one line: `encoder_stuck wheel=left duration=0.5`.

The kinds stand in `fault_catalogue`. A fault that lasts ends by itself after its `duration`, or by
`clear`; faults of the bus end by themselves alone.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from firmware_sim.bus.faults import Fault as BusFault
from firmware_sim.errors import SimulationError
from firmware_sim.fault_catalogue import CATALOGUE
from firmware_sim.fault_kinds import DURATION, Arguments, Kind, Undo, Value, nearest, shown
from firmware_sim.faulty_parts import FaultyRing, FaultyStage
from firmware_sim.nodes import wire

if TYPE_CHECKING:
    from firmware_sim.simulation import Simulation

CLEAR = "clear"
_HOST: Final = re.compile(r"host(#\d+)?|bridge:.*")
"""Name of a port that host programs have, with a number where there are several."""
MILLISECOND_NS = 1_000_000


class Faults:
    """The faults of one simulation.

    Parameters
    ----------
    simulation
        The robot that they befall.
    stage
        What its drive reads.
    ring
        What its sonars hear.
    rng
        Of the noise of broken sensors.
    """

    def __init__(
        self,
        simulation: Simulation,
        stage: FaultyStage,
        ring: FaultyRing,
        rng: np.random.Generator,
    ) -> None:
        self.simulation = simulation
        self.stage: FaultyStage = stage
        self.ring: FaultyRing = ring
        self.rng = rng
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
        """Let a fault begin now; raises SimulationError where it is wrong, or not of this robot."""
        kind, arguments = check(name, given)
        misfits = [
            f"fault {name}: {key}: {problem}"
            for key, problem in kind.fits(self.simulation.config, arguments)
        ]
        if misfits:
            raise SimulationError("; ".join(misfits))
        self._catch_up()
        undo = kind.begin(self, arguments)
        if undo is None:
            return
        self._present.append(undo)
        duration_s = float(arguments[DURATION])
        if duration_s > 0.0:
            bus = self.simulation.bus
            bus.schedule(bus.now_ns + round(duration_s * 1e9), partial(self._finish, undo))

    def clear(self) -> None:
        """End all faults that last; those of the bus end by themselves."""
        for undo in list(self._present):
            self._finish(undo)

    def _finish(self, undo: Undo) -> None:
        if undo in self._present:
            self._present.remove(undo)
            self._catch_up()
            undo()

    def _catch_up(self) -> None:
        """Bring the robot to the present: what changes now has not been so before."""
        self.simulation.run_to(self.simulation.now_ns)

    def repeat(self, action: Callable[[], None], period_ns: int = MILLISECOND_NS) -> Undo:
        """Do something now and then each period; return what ends that."""
        bus = self.simulation.bus
        goes_on = True

        def tick() -> None:
            if goes_on:
                self._catch_up()
                action()
                bus.schedule(bus.now_ns + period_ns, tick)

        def end() -> None:
            nonlocal goes_on
            goes_on = False

        tick()
        return end

    def end_ns(self, arguments: Arguments) -> int:
        """Return the time at which a fault with these arguments ends if it begins now [ns]."""
        return self.simulation.bus.now_ns + round(float(arguments[DURATION]) * 1e9)

    def on_bus(self, make: Callable[..., BusFault], arguments: Arguments, **more: object) -> None:
        """Inject a fault of the bus from now for its duration."""
        bus = self.simulation.bus
        bus.inject(make(start_ns=bus.now_ns, end_ns=self.end_ns(arguments), **more))

    def on_frames(
        self, make: Callable[..., BusFault], arguments: Arguments, **more: object
    ) -> None:
        """Inject a fault of frames: with the identifier and the probability of the arguments."""
        number = int(float(arguments["id"]))
        self.on_bus(
            make,
            arguments,
            arbitration_id=number or None,
            probability=float(arguments["probability"]),
            **more,
        )

    def host(self) -> str:
        """Name of the host's port: it has the name of one and commands the motors.

        Where none does both, the port that commands them, or has the name.

        Raises
        ------
        SimulationError
            Where no host is on the bus, or several could be it.
        """
        nodes = {node.name for node in self.simulation.nodes}
        guests = [port for port in self.simulation.bus.ports if port.name not in nodes]
        commanding = [port for port in guests if port.has_sent(wire.MOTOR_COMMAND)]
        named = [port for port in guests if _HOST.fullmatch(port.name)]
        both = [port for port in named if port in commanding]
        found = [port.name for port in both or commanding or named]
        if not found:
            raise SimulationError("no host is on the bus")
        if len(found) > 1:
            raise SimulationError(
                f"{', '.join(found)} could be the host, allowed: one that sends motor commands"
            )
        return found[0]


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
