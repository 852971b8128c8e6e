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
    """There is nothing to check on this machine."""


class Finding(msgspec.Struct, frozen=True):
    """The result of one check.

    Attributes
    ----------
    check
        Its name.
    verdict
        How it came out.
    found
        What was found, with units.
    fix
        What to do, for a verdict of FAIL or WARN; one line.
    """

    check: str
    verdict: Verdict
    found: str
    fix: str = ""


def ok(check: str, found: str) -> Finding:
    """Return a finding that all is well."""
    return Finding(check, Verdict.OK, found)


def warn(check: str, found: str, fix: str) -> Finding:
    """Return a finding that the robot drives with, but not as well as it could."""
    return Finding(check, Verdict.WARN, found, fix)


def fail(check: str, found: str, fix: str) -> Finding:
    """Return a finding that must be mended."""
    return Finding(check, Verdict.FAIL, found, fix)


def risk(check: str, found: str) -> Finding:
    """Return a finding that the robot's file takes on deliberately."""
    return Finding(check, Verdict.RISK, found)


def none(check: str, found: str) -> Finding:
    """Return that there is nothing to check."""
    return Finding(check, Verdict.NONE, found)
