"""The results of a campaign: a folder that takes each as it comes, and is whole after a kill."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import msgspec

import robotctl
from firmware_sim.faults.parameters import FAILED
from robotctl.errors import ConfigError
from robotctl.runtime.storage.atomic_file import write_whole
from robotctl.runtime.storage.ring_file import hold
from robotctl.workbench.campaign.campaign_file import Campaign
from robotctl.workbench.campaign.conditions import (
    Condition,
    parse_condition,
    read_report,
    violations,
)
from robotctl.workbench.campaign.plan import CASE, Run, command_of

HEAD, RUNS, PAGE = "campaign.json", "runs.jsonl", "report.html"
"""Files of a folder."""


class Head(msgspec.Struct, frozen=True):
    """Identity of the campaign whose results a folder has.

    Attributes
    ----------
    name
        Name of the campaign.
    version, sources
        robotctl's version, and a hash of its sources.
    fingerprint
        Hash of all commands and of the files that they name.
    runs
        Number of runs.
    criteria
        What a run must fulfil to pass.
    case_criteria
        Criteria of the cases that have their own, by name.
    """

    name: str
    version: str
    sources: str
    fingerprint: str
    runs: int
    criteria: tuple[str, ...]
    case_criteria: dict[str, tuple[str, ...]] = {}

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The conditions of all criteria."""
        all_criteria = (*self.criteria, *itertools.chain(*self.case_criteria.values()))
        return tuple(map(parse_condition, dict.fromkeys(all_criteria)))

    def criteria_of(self, factors: Mapping[str, Any]) -> tuple[str, ...]:
        """Return what a run with these factors must fulfil to pass."""
        return self.case_criteria.get(factors.get(CASE, ""), self.criteria)

    def conditions_of(self, result: Result) -> tuple[Condition, ...]:
        """Return the conditions on a run."""
        return tuple(map(parse_condition, self.criteria_of(result.factors)))

    def judge(self, result: Result) -> Verdict:
        """Return whether a run passes."""
        return judge(result, self.conditions_of(result))


class Result(msgspec.Struct, frozen=True):
    """The result of one run; see `Run` for number, factors and words.

    Attributes
    ----------
    report
        Its report, without what differs between two runs of one seed; None without a result.
    reason
        Why there is no result.
    """

    number: int
    factors: dict[str, Any]
    words: tuple[str, ...]
    report: dict[str, Any] | None = None
    reason: str = ""

    @property
    def command(self) -> str:
        """The command that drives it again."""
        return command_of(self.words)


def result_of(run: Run, report: bytes, reason: str) -> Result:
    """Return the result of a run that ended so; see `Ending`."""
    if not report:
        return Result(run.number, dict(run.factors), run.words, None, reason)
    return Result(run.number, dict(run.factors), run.words, read_report(report))


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict on a run: `passed`; None: there is no result; and why it did not pass."""

    passed: bool | None
    why: tuple[str, ...] = ()


def judge(result: Result, conditions: Iterable[Condition]) -> Verdict:
    """Return whether a run passes.

    One that would, but under a fault that never began, has tested nothing: it has no result.
    """
    if result.report is None:
        return Verdict(None, (result.reason,))
    if why := violations(conditions, result.report):
        return Verdict(False, why)
    unmet = tuple(each for each in result.report["faults"] if FAILED in each)
    return Verdict(None, unmet) if unmet else Verdict(True)


class ResultFolder:
    """Takes the results of a campaign; use as a context manager.

    Parameters
    ----------
    folder
        Made if it does not exist; one of the same campaign goes on.
    head
        What the results are of.

    Raises
    ------
    ConfigError
        If the folder is of another campaign, or another process writes it.
    OSError
        If it cannot be written.

    Attributes
    ----------
    done
        Results so far, by number; without those that have none, which are to be run again.
    """

    def __init__(self, folder: Path, head: Head) -> None:
        self.folder = folder
        self._head = head
        folder.mkdir(parents=True, exist_ok=True)
        before = _read_head(folder)
        if before is not None:
            _refuse_other(folder, before, head)
        self._file: BinaryIO = (folder / RUNS).open("ab")
        if not hold(self._file):
            self._file.close()
            raise ConfigError(f"{folder}: another campaign is writing it now")
        write_whole(folder / HEAD, msgspec.json.format(msgspec.json.encode(head)) + b"\n")
        self.done = {each.number: each for each in read_runs(folder) if each.report is not None}
        self._rewrite()

    def has(self, run: Run) -> bool:
        """Return whether a run has a result; an earlier search may have had another there."""
        kept = self.done.get(run.number)
        return kept is not None and kept.words == run.words

    def passes(self, run: Run) -> bool | None:
        """Return whether a run passes; None: it has no result."""
        return self._head.judge(self.done[run.number]).passed if self.has(run) else None

    def add(self, result: Result) -> None:
        """Keep a result; raises OSError if the disk refuses."""
        if result.report is not None:
            self.done[result.number] = result
        self._file.write(_line(result))
        self._file.flush()

    def finish(self, missing: Sequence[Result]) -> None:
        """Bring the file into the order of the runs, with those that have no result."""
        self._rewrite(missing)

    def _rewrite(self, missing: Sequence[Result] = ()) -> None:
        """Rewrite the file: in order, and without a line that a kill cut short."""
        found = sorted((*self.done.values(), *missing), key=lambda each: each.number)
        write_whole(self.folder / RUNS, b"".join(map(_line, found)))
        self._file.close()
        self._file = (self.folder / RUNS).open("ab")
        hold(self._file)

    def __enter__(self) -> ResultFolder:
        return self

    def __exit__(self, *_error: object) -> None:
        os.fsync(self._file.fileno())
        self._file.close()


def read_folder(folder: Path) -> tuple[Head, list[Result]]:
    """Return what the results of a folder are of, and all results in the order of the runs.

    Raises
    ------
    ConfigError
        If it is no folder of results.
    """
    head = _read_head(folder)
    if head is None:
        raise ConfigError(f"{folder}: no results of `robotctl campaign`: it has no {HEAD}")
    found = {each.number: each for each in read_runs(folder)}
    return head, [found[number] for number in sorted(found)]


def read_runs(folder: Path) -> list[Result]:
    """Return the results of a folder as they came; a last line that was cut short is left out."""
    found = []
    *lines, _cut = (folder / RUNS).read_bytes().split(b"\n")
    for number, line in enumerate(lines, 1):
        try:
            found.append(msgspec.json.decode(line, type=Result))
        except msgspec.DecodeError as error:
            raise ConfigError(f"{folder / RUNS}:{number}: damaged: {error}") from error
    return found


def _line(result: Result) -> bytes:
    return msgspec.json.encode(result) + b"\n"


def _read_head(folder: Path) -> Head | None:
    """Return the head of a folder; None if it has none."""
    try:
        return msgspec.json.decode((folder / HEAD).read_bytes(), type=Head)
    except FileNotFoundError:
        return None
    except msgspec.DecodeError as error:
        raise ConfigError(f"{folder / HEAD}: damaged: {error}") from error


def _refuse_other(folder: Path, before: Head, now: Head) -> None:
    """Refuse to mix results of two campaigns; what is a pass may change, no run depends on it.

    Raises
    ------
    ConfigError
        With what is different.
    """
    different: Mapping[str, bool] = {
        "of other runs, or of files that have changed since": before.fingerprint != now.fingerprint,
        f"of another robotctl ({before.version})": before.sources != now.sources,
    }
    for what, is_so in different.items():
        if is_so:
            raise ConfigError(
                f"{folder}: its results are {what}; name another folder with --results, or remove "
                "this one"
            )


def head_of(name: str, runs: int, campaign: Campaign, prints: tuple[str, str]) -> Head:
    """Return the head of results that are driven now; `prints`: of campaign and sources."""
    version, criteria = robotctl.__version__, campaign.criteria
    return Head(name, version, prints[1], prints[0], runs, criteria, campaign.case_criteria)
