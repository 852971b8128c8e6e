"""`robotctl setup`: the guided first day of a robot."""

from __future__ import annotations

import shutil
import signal
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.console import plain_console
from robotctl.config.robot_file import config_directory, find_file
from robotctl.errors import ConfigError

if TYPE_CHECKING:
    from robotctl.deploy.setup.bench import Buses
    from robotctl.deploy.setup.dialogue import Person
    from robotctl.deploy.setup.guide import Guide
    from robotctl.deploy.setup.registry import Step

NOT_DONE = 1


def setup(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="[STEP] ROBOT",
            help="Robot's file, which is changed; before it a single step to do, e.g. prove.",
        ),
    ],
    undo: Annotated[
        bool, typer.Option("--undo", help="Take back what the step has written.")
    ] = False,
    simulate: Annotated[
        bool,
        typer.Option(
            "--simulate",
            help="Try it on the simulated robot, with a simulated person, on a copy of the file.",
        ),
    ] = False,
) -> None:
    """Lead through the first day of a robot, and write what is found into its file.

    All drives and sensors are found, wheels and directions put right, each drive proven to stop
    when this computer is silent. Goes on where it was left; Ctrl-C ends it with the motors off.
    Status 0: done. 1: something is left to do. 2: bad input.
    """
    from robotctl.cli.setup.terminal import Terminal, Witnessed  # noqa: PLC0415
    from robotctl.deploy.setup.guide import Guide  # noqa: PLC0415

    step, robot = _step_and_robot(words, undo=undo)
    file = find_file(robot)
    with ExitStack() as held:
        buses: Buses
        person: Person
        if simulate:
            file = Path(held.enter_context(tempfile.TemporaryDirectory())) / file.name
            shutil.copy(find_file(robot), file)
            buses, person = _simulated(file)
            person = Witnessed(person)
        else:
            _refuse_shipped(file)
            person = Terminal()
            buses = _real(file, held)
            # A closed terminal ends it as Ctrl-C does: motors off, buses released.
            signal.signal(signal.SIGHUP, signal.default_int_handler)
            signal.signal(signal.SIGTERM, signal.default_int_handler)
        is_done = _done(Guide(file, buses, person), step, undo=undo)
        if simulate:
            print(f"\nThe file would be:\n\n{file.read_text(encoding='utf-8')}")
    sys.exit(0 if is_done else NOT_DONE)


def _step_and_robot(words: list[str], *, undo: bool) -> tuple[Step | None, str]:
    """Return the single step to do, None for all, and the robot; raises `ConfigError`."""
    from robotctl.deploy.setup.registry import STEPS  # noqa: PLC0415

    names = [step.name for step in STEPS]
    *step_words, robot = words
    if len(step_words) > 1 or (step_words and step_words[0] not in names) or robot in names:
        found = " ".join(words)
        raise ConfigError(f"{found}: [STEP] ROBOT needed, STEP one of {', '.join(names)}")
    if undo and not step_words:
        raise ConfigError(f"--undo: needs a step before the robot: {', '.join(names)}")
    return STEPS[names.index(step_words[0])] if step_words else None, robot


def _done(guide: Guide, step: Step | None, *, undo: bool) -> bool:
    """Do all steps or one, or undo it; return whether nothing is left to do."""
    from robotctl.deploy.setup.dialogue import PersonLeftError  # noqa: PLC0415

    try:
        if step is None:
            return guide.walk()
        if undo:
            guide.undo(step)
            return True
        return guide.run(step)
    except PersonLeftError as error:
        plain_console(stderr=True).print(f"robotctl: {error}", soft_wrap=True)
        return False


def _simulated(file: Path) -> tuple[Buses, Person]:
    """Return the buses of a simulated robot, and a person beside it."""
    from robotctl.cli.setup.simulated import SimulatedBuses, SimulatedPerson  # noqa: PLC0415

    buses = SimulatedBuses(file)
    return buses, SimulatedPerson(buses.simulation)


def _real(file: Path, held: ExitStack) -> Buses:
    """Return the buses of a robot, claimed while `held` is open."""
    from robotctl.config.robot_file import load_robot  # noqa: PLC0415
    from robotctl.deploy.setup.real_buses import RealBuses  # noqa: PLC0415

    buses = RealBuses(load_robot(file))
    held.enter_context(buses.claimed())
    return buses


def _refuse_shipped(file: Path) -> None:
    """Refuse to change a file that comes with robotctl.

    Raises
    ------
    ConfigError
        With the command that copies it.
    """
    if file.resolve().parent == config_directory().resolve():
        own = f"my_{file.name}"
        raise ConfigError(
            f"{file}: comes with robotctl and is not changed; copy it first:\n"
            f"  cp {file} {own} && robotctl setup {own}"
        )
