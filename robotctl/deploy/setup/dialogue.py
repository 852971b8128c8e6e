"""Questions and answers of the set-up, independent of terminal or web page.

A step is a generator: it yields `Tell` and `Ask`, receives the answer to each `Ask`, and returns
the changes of the robot's file.
"""

from __future__ import annotations

import enum
from collections.abc import Generator
from dataclasses import dataclass
from typing import Final, Protocol, TypeAlias

from robotctl.config.file_edit import Change
from robotctl.errors import RobotctlError

Answer: TypeAlias = str | float


class Topic(enum.Enum):
    """Topics of questions, for pages with pictures and for simulated people."""

    BLOCKS = "the robot is on blocks"
    TURN = "turn a wheel by hand"
    WHEEL = "which wheel turned"
    WAY = "which way it turned"
    NUMBER = "number of a drive on its bus"
    COUNTS = "counts per revolution"
    SCALE = "which of several keys is wrong"
    SPEED = "greatest speed"
    PRESS = "press the emergency stop"
    RELEASE = "release the emergency stop"
    HAND = "hold a hand before a sonar"
    AWAY = "take the hand away"
    TILT = "tilt the robot"
    LEVEL = "put the robot level"
    TURN_LEFT = "turn the robot to the left"
    BODY = "how far the robot reaches"
    AGAIN = "try again or give up"
    NEXT = "what to do after a step"


class Kind(enum.Enum):
    """Kinds of answers."""

    DONE = "done"
    YES_NO = "yes or no"
    CHOICE = "one of several"
    NUMBER = "number"


@dataclass(frozen=True, slots=True)
class Tell:
    """A sentence for the person."""

    text: str


@dataclass(frozen=True, slots=True)
class Ask:
    """A question.

    Parameters
    ----------
    topic
        Topic.
    text
        The question.
    kind
        Kind of the answer.
    choices
        Answers to choose from.
    default
        Answer of an empty line.
    subject
        Name of the wheel, drive or sensor concerned.
    loose
        Whether wheels may be turned by hand meanwhile; else drives brake them if they can.
    """

    topic: Topic
    text: str
    kind: Kind = Kind.DONE
    choices: tuple[str, ...] = ()
    default: str = ""
    subject: str = ""
    loose: bool = False

    @property
    def allowed(self) -> tuple[str, ...]:
        """Answers to choose from; empty for a number or "done"."""
        return ("yes", "no") if self.kind is Kind.YES_NO else self.choices

    def read(self, text: str) -> Answer:
        """Return the answer in a text; the beginning of a choice suffices.

        Raises
        ------
        ValueError
            If the text is not an answer; names the allowed ones.
        """
        word = text.strip() or self.default
        if self.kind is Kind.DONE:
            return "done"
        if self.kind is Kind.NUMBER:
            try:
                return float(word)
            except ValueError:
                raise ValueError(f"{word!r} is no number") from None
        if word in self.allowed:
            return word
        found = [each for each in self.allowed if word and each.startswith(word.lower())]
        if len(found) == 1:
            return found[0]
        raise ValueError(f"{word!r} found, please answer {', '.join(self.allowed)}")


Changes: TypeAlias = tuple[Change, ...]
Script: TypeAlias = Generator[Ask | Tell, Answer, Changes]

NO_CHANGES: Final[Changes] = ()


class UnfinishedError(RobotctlError):
    """A step could not be completed; the sentence has the reason and the remedy.

    Parameters
    ----------
    text
        The sentence.
    changes
        Changes to write nevertheless.
    """

    def __init__(self, text: str, changes: Changes = NO_CHANGES) -> None:
        super().__init__(text)
        self.changes = changes


class PersonLeftError(RobotctlError):
    """The person has left, and the motors are off."""


class Person(Protocol):
    """A person who sees the robot and answers."""

    def tell(self, text: str) -> None:
        """Show a sentence."""

    def ask(self, question: Ask) -> None:
        """Show a question."""

    def answer(self) -> str | None:
        """Return the answer to the last question, without waiting; None: not yet.

        Raises
        ------
        PersonLeftError
            If the person has left.
        """

    def interrupts(self) -> bool:
        """Return whether a motion must stop now: a key was pressed, or the person has left."""
