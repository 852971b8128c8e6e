"""Results of `robotctl doctor`: one value for each check."""

from __future__ import annotations

import enum

import msgspec


class Verdict(enum.StrEnum):
    """Result of a check."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"
    RISK = "risk"
    """A risk that the robot's file takes on deliberately."""
    NONE = "none"
    """Nothing to check on this machine."""


class Finding(msgspec.Struct, frozen=True):
    """The result of one check.

    Attributes
    ----------
    check
        Name of the check.
    verdict
        Result.
    found
        Facts found, with units.
    fix
        Remedy for a verdict of FAIL or WARN; one line.
    """

    check: str
    verdict: Verdict
    found: str
    fix: str = ""


def ok(check: str, found: str) -> Finding:
    """Return a finding without a problem."""
    return Finding(check, Verdict.OK, found)


def warn(check: str, found: str, fix: str) -> Finding:
    """Return a finding with which the robot drives, but not as well as it could."""
    return Finding(check, Verdict.WARN, found, fix)


def fail(check: str, found: str, fix: str) -> Finding:
    """Return a finding that must be fixed."""
    return Finding(check, Verdict.FAIL, found, fix)


def risk(check: str, found: str) -> Finding:
    """Return a finding that the robot's file takes on deliberately."""
    return Finding(check, Verdict.RISK, found)


def none(check: str, found: str) -> Finding:
    """Return a finding that there is nothing to check."""
    return Finding(check, Verdict.NONE, found)
