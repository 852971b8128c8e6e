"""The guide through the steps: asks, runs, writes the robot's file, and stores the progress."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec

from robotctl.config.file_edit import Change
from robotctl.config.file_writing import changed_file
from robotctl.config.robot_file import load_robot
from robotctl.deploy.setup.bench import CREEP_M_S, SLOW_M_S, Bench, Buses
from robotctl.deploy.setup.dialogue import (
    Answer,
    Ask,
    Changes,
    Kind,
    Person,
    Tell,
    Topic,
    UnfinishedError,
)
from robotctl.deploy.setup.progress import load_progress, progress_file
from robotctl.deploy.setup.registry import STEPS, Step
from robotctl.errors import ConfigError
from robotctl.runtime.storage.atomic_file import write_whole

_RUNS_MAX: Final = 4
"""Maximum runs of a step that repeats."""


class Guide:
    """Leads a person through the steps.

    Parameters
    ----------
    file
        Robot's file, which is changed.
    buses
        Buses of the robot.
    person
        Person who answers.

    Raises
    ------
    ConfigError
        If the file or the progress record is invalid.
    """

    def __init__(self, file: Path, buses: Buses, person: Person) -> None:
        self._file = file.resolve()
        self._buses = buses
        self._person = person
        self._progress = load_progress(file)
        load_robot(file)

    @property
    def done(self) -> frozenset[str]:
        """Names of the steps that are done."""
        return frozenset(self._progress.done)

    def walk(self) -> bool:
        """Do all steps that are not done yet; return whether all are done."""
        for number, step in enumerate(STEPS, 1):
            if step.name in self.done:
                self._person.tell(f"{number}. {step.title}: done before")
                continue
            while True:
                self._person.tell(f"{number}. {step.title}")
                is_done = self.run(step)
                choice = self._ask_next(is_done=is_done)
                if choice == "undo":
                    self.undo(step)
                if choice == "stop":
                    return False
                if choice == "go on":
                    break
        return self.done >= {step.name for step in STEPS}

    def _ask_next(self, *, is_done: bool) -> str:
        """Ask what to do after a step."""
        choices = ("go on", "again", "undo", "stop") if is_done else ("again", "go on", "stop")
        text = "Go on?" if is_done else "This step is not done."
        ask = Ask(Topic.NEXT, text, Kind.CHOICE, choices, choices[0])
        with Bench(load_robot(self._file), self._buses) as bench:
            return str(self._put(ask, bench))

    def run(self, step: Step) -> bool:
        """Do a step, once or until it finds nothing to change; return whether it succeeded."""
        try:
            self._repeat(step)
        except UnfinishedError as error:
            self._person.tell(str(error))
            return False
        self._progress.finish(step.name)
        self._save()
        return True

    def _repeat(self, step: Step) -> None:
        """Run a step once, or until it finds nothing to change.

        Raises
        ------
        UnfinishedError
            If the step cannot be completed.
        """
        for _ in range(_RUNS_MAX):
            try:
                changes = self._once(step)
            except UnfinishedError as error:
                self._keep(step, error.changes)
                raise
            self._keep(step, changes)
            if not (changes and step.repeats):
                return
        raise UnfinishedError(f"{step.title}: changed {_RUNS_MAX} times, and is still not right")

    def _keep(self, step: Step, changes: Changes) -> None:
        """Write the findings of a step.

        Raises
        ------
        UnfinishedError
            If the file would be invalid with them.
        """
        try:
            undo = self._write(changes)
        except ConfigError as error:
            raise UnfinishedError(f"not written, as the file would be wrong:\n{error}") from error
        self._progress.note(step.name, undo)
        self._save()

    def _once(self, step: Step) -> Changes:
        """Run a step to its end."""
        slow_m_s = SLOW_M_S if "counts" in self.done else CREEP_M_S
        config, interrupts = load_robot(self._file), self._person.interrupts
        with Bench(config, self._buses, interrupts, slow_m_s) as bench:
            script = step.run(bench)
            answer: Answer = ""
            try:
                while True:
                    event = script.send(answer) if answer else next(script)
                    if isinstance(event, Tell):
                        self._person.tell(event.text)
                        answer = ""
                    else:
                        answer = self._put(event, bench)
            except StopIteration as end:
                changes: Changes = end.value
                return changes

    def _put(self, question: Ask, bench: Bench) -> Answer:
        """Ask, and keep the motors off until there is an answer."""
        person = self._person
        person.ask(question)
        while True:
            text = person.answer()
            if text is not None:
                try:
                    return question.read(text)
                except ValueError as error:
                    person.tell(str(error))
                    person.ask(question)
            bench.rest(loose=question.loose)

    def undo(self, step: Step) -> None:
        """Undo the changes of a step."""
        self._write(self._progress.changes(step.name))
        self._progress.forget(step.name)
        self._save()
        self._person.tell(f"{step.name}: undone")

    def _write(self, changes: Changes) -> Changes:
        """Write changes into the robot's file; return those that undo them.

        Raises
        ------
        ConfigError
            If the file would be invalid with them; it then stays unchanged.
        """
        if not changes:
            return ()
        after, undo = changed_file(self._file, changes)
        write_whole(self._file, after)
        for change in changes:
            self._person.tell(f"{self._file}: {_words(change)}")
        return undo

    def _save(self) -> None:
        """Keep the progress."""
        record = msgspec.json.format(msgspec.json.encode(self._progress))
        write_whole(progress_file(self._file), record)


def _words(change: Change) -> str:
    """Return a change as text for people."""
    key = ".".join(map(str, change.key))
    return f"{key} taken out" if change.value is None else f"{key} = {change.value!r}"
