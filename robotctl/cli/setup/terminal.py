"""A person at the terminal."""

from __future__ import annotations

import os
import select
import sys

from robotctl.cli.console import plain_console
from robotctl.deploy.setup.dialogue import Ask, Kind, Person, PersonLeftError


class Terminal:
    """Prints questions and reads answers without waiting; Enter stops a motion."""

    def __init__(self) -> None:
        self._console = plain_console()
        self._line = b""

    def tell(self, text: str) -> None:
        """Print a sentence."""
        self._console.print(text, soft_wrap=True)

    def ask(self, question: Ask) -> None:
        """Print a question, and what was typed before it is no answer."""
        self._read()
        self._line = b""
        self._console.print(f"? {prompt(question)} ", soft_wrap=True, end="")

    def answer(self) -> str | None:
        """Return a line that was typed."""
        if not self._read():
            raise PersonLeftError("the terminal is gone; the motors are off")
        line, separator, rest = self._line.partition(b"\n")
        if not separator:
            return None
        self._line = rest
        return line.decode(errors="replace")

    def interrupts(self) -> bool:
        """Return whether something was typed, or the terminal is gone."""
        return not self._read() or bool(self._line)

    def _read(self) -> bool:
        """Take what was typed; return False if nothing will be any more."""
        descriptor = sys.stdin.fileno()
        while select.select([descriptor], [], [], 0.0)[0]:
            try:
                typed = os.read(descriptor, 1024)
            except OSError:
                return False
            if not typed:
                return False
            self._line += typed
        return True


class Witnessed:
    """Another person, whose answers are printed: `robotctl setup --simulate`."""

    def __init__(self, person: Person) -> None:
        self._person = person
        self._console = plain_console()

    def tell(self, text: str) -> None:
        """Print and pass on a sentence."""
        self._console.print(text, soft_wrap=True)
        self._person.tell(text)

    def ask(self, question: Ask) -> None:
        """Print and pass on a question."""
        self._console.print(f"? {prompt(question)} ", soft_wrap=True, end="")
        self._person.ask(question)

    def answer(self) -> str | None:
        """Print and return the answer."""
        answer = self._person.answer()
        if answer is not None:
            self._console.print(answer, soft_wrap=True)
        return answer

    def interrupts(self) -> bool:
        """Return whether the person interrupts."""
        return self._person.interrupts()


def prompt(question: Ask) -> str:
    """Return a question with what may be answered; an empty line gives what is in brackets."""
    if question.kind is Kind.DONE:
        return f"{question.text} [Enter]"
    choices = f" {'/'.join(question.allowed)}" if question.allowed else ""
    default = f" [{question.default}]" if question.default else ""
    return f"{question.text}{choices}{default}"
