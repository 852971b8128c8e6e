"""Results with as much of a report as the tests need."""

from typing import Any

from robotctl.workbench.campaign.results import Head, Result


def head(runs: int, *criteria: str) -> Head:
    """Return the head of results."""
    return Head("test", "0.1.0", "s", "f", runs, criteria or ("mission_completed = true",))


def result(number: int, passed: bool | None, factors: dict[str, Any], **fields: Any) -> Result:
    """Return a result; `passed` None: without one."""
    words = ("sim", "--seed", str(factors.get("seed", number)))
    if passed is None:
        return Result(number, factors, words, None, "killed")
    report = {"mission_completed": passed, "faults": [], **fields}
    return Result(number, factors, words, report)
