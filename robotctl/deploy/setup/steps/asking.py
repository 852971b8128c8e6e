"""Questions common to several steps."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, TypeAlias

from robotctl.deploy.setup.bench import Bench
from robotctl.deploy.setup.dialogue import Answer, Ask, Kind, Tell, Topic, UnfinishedError

Question: TypeAlias = Generator[Ask | Tell, Answer, Any]

_BLOCKS = (
    "Put the robot on blocks so that all wheels are free, and nothing can be caught by them. "
    "The next motions are slow; Enter stops one."
)


def on_blocks() -> Question:
    """Ask to put the robot on blocks."""
    yield Ask(Topic.BLOCKS, _BLOCKS)


def confirm(topic: Topic, text: str, subject: str = "") -> Generator[Ask | Tell, Answer, bool]:
    """Ask a yes/no question; return whether the answer is yes."""
    return (yield Ask(topic, text, Kind.YES_NO, default="yes", subject=subject)) == "yes"


def again_or_give_up(problem: str, remedy: str) -> Question:
    """Report a problem, and wait until the person wants to try again.

    Raises
    ------
    UnfinishedError
        If the person gives up.
    """
    yield Tell(f"{problem}. {remedy}.")
    text = "Try again, or give up?"
    if (yield Ask(Topic.AGAIN, text, Kind.CHOICE, ("again", "give up"), "again")) != "again":
        raise UnfinishedError(problem)


def in_service(bench: Bench) -> Question:
    """Wait until all drives and nodes are in service, and no drive is latched.

    Between two steps nothing is sent to the drives, and some latch that.
    """
    while True:
        bench.commission()
        problem = next((status.problem for status in bench.statuses if status.problem), "")
        remedy = "The step `nodes` says what to do"
        if not problem:
            if bench.recover():
                return
            problem = bench.latched
            remedy = "Find out why; release the emergency stop; or switch the drives off and on"
        yield from again_or_give_up(problem, remedy)
