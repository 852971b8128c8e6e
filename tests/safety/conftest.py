"""Each fault that a test here brings about has the code and the part that its text says."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety import (
    health,
    plausibility,
    plausibility_imu,
    plausibility_sonar,
    plausibility_values,
    supervision,
)

DOCUMENT = Path(__file__).parents[2] / "docs" / "safety.md"
MODULES = (
    health, plausibility, plausibility_imu, plausibility_sonar, plausibility_values, supervision,
)  # fmt: skip
OF_A_PART = re.compile(r"(sonar )?(\S+)( wheel)? (encoder|is blocked|pushes|has given|is stuck)")


def documented() -> list[tuple[re.Pattern[str], set[FaultCode]]]:
    """Return how reasons to stop begin, by the table of the page, and which codes they have."""
    rows = []
    for line in DOCUMENT.read_text(encoding="utf-8").splitlines():
        cells = line.split(" | ")
        codes = re.findall(r"([A-Z]+(?:_[A-Z]+)+) \d+", cells[1]) if len(cells) == 4 else []
        for text in re.findall("`([^`]+)`", cells[0]) if codes else ():
            words = re.escape(text).replace("NAME", r"\S+").replace("N\\ ", r"\S+ ")
            pattern = re.compile(words.replace("…", ".*"))
            rows.append((pattern, {FaultCode[code] for code in codes}))
    return rows


@pytest.fixture(scope="session")
def reasons() -> list[tuple[re.Pattern[str], set[FaultCode]]]:
    rows = documented()
    assert len(rows) > 30
    return rows


@pytest.fixture(autouse=True)
def faults_mean_what_they_say(
    monkeypatch: pytest.MonkeyPatch, reasons: list[tuple[re.Pattern[str], set[FaultCode]]]
) -> None:
    def checked(code: FaultCode, text: str, part: str = "") -> Fault:
        assert isinstance(code, FaultCode)
        assert isinstance(text, str)
        assert isinstance(part, str)
        codes = [codes for pattern, codes in reasons if pattern.match(text)]
        assert not codes or any(code in each for each in codes), (code, text)
        if (named := OF_A_PART.match(text)) and "encoders" not in text:
            assert part == named[2], (part, text)
        return Fault(code, text, part)

    make: Callable[..., Fault] = checked
    for module in MODULES:
        monkeypatch.setattr(module, "Fault", make)
