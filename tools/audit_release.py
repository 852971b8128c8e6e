"""Published weaknesses of the packages that robotctl and its page bring along, for `make release`.

The answers of pip-audit and `npm audit --json` stand in two files. Status 1: one names a weakness,
or is unclear. A service that is not reached is said, and stops nothing.
"""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

NOT_REACHED = "not audited: service not reached"


class Verdict(NamedTuple):
    """What an audit has found, and whether a release may go on."""

    text: str
    may_go_on: bool


def of_python(answer: str, errors: str) -> Verdict:
    """Return the verdict of pip-audit's report.

    A service that knows none of the packages, as a mirror of files does, is none of advisories.
    """
    report = _parsed(answer)
    if report is None:
        return _without_report(
            errors, ("Could not connect", "Max retries exceeded", "Read timed out")
        )
    packages = report["dependencies"]
    skipped = sorted(each["name"] for each in packages if "skip_reason" in each)
    weak = [
        f"{each['name']} {each['version']} ({', '.join(found['id'] for found in each['vulns'])})"
        for each in packages
        if each.get("vulns")
    ]
    if weak:
        return Verdict(f"weak: {', '.join(weak)}", may_go_on=False)
    if packages and len(skipped) == len(packages):
        return Verdict(NOT_REACHED, may_go_on=True)
    if skipped or not packages:
        return Verdict(f"cannot be judged: {', '.join(skipped) or 'no package'}", may_go_on=False)
    return Verdict(f"{len(packages)} packages, no known weakness", may_go_on=True)


def of_page(answer: str, errors: str) -> Verdict:
    """Return the verdict of npm's report."""
    report = _parsed(answer)
    if report is None or "metadata" not in report:
        return _without_report(errors, ("audit endpoint returned an error",))
    weak = [f"{name} ({each['severity']})" for name, each in report["vulnerabilities"].items()]
    if weak:
        return Verdict(f"weak: {', '.join(weak)}", may_go_on=False)
    total = report["metadata"]["dependencies"]["total"]
    return Verdict(f"{total} packages, no known weakness", may_go_on=True)


def _without_report(errors: str, unreached: tuple[str, ...]) -> Verdict:
    """Return the verdict where there are only a program's complaints."""
    if any(words in errors for words in unreached):
        return Verdict(NOT_REACHED, may_go_on=True)
    last = errors.strip().splitlines()[-1:] or ["no answer"]
    return Verdict(f"cannot be judged: {last[0]}", may_go_on=False)


def _parsed(answer: str) -> Any:
    """Return a report, None where there is none."""
    with suppress(ValueError):
        return json.loads(answer)
    return None


def main() -> int:
    """Print both verdicts; ANSWER.err beside an answer has the program's complaints."""
    good = True
    for name, judge, path in zip(
        ("Python packages", "web page"), (of_python, of_page), map(Path, sys.argv[1:]), strict=True
    ):
        verdict = judge(path.read_text(), path.with_name(f"{path.name}.err").read_text())
        print(f"audit of the {name}: {verdict.text}")
        good &= verdict.may_go_on
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
