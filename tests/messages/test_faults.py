"""Each kind of fault stands in docs/safety.md with its number, and prints as its text."""

import re
from pathlib import Path

from robotctl.messages.faults import Fault, FaultCode

DOCUMENT = Path(__file__).parents[2] / "docs" / "safety.md"
CODE = re.compile(r"\b([A-Z]+(?:_[A-Z]+)+) (\d+)\b")


def test_every_code_stands_in_the_document_once_with_its_number() -> None:
    documented = CODE.findall(DOCUMENT.read_text(encoding="utf-8"))
    in_the_code = sorted((code.name, str(code.value)) for code in FaultCode if code)
    assert sorted(documented) == in_the_code


def test_a_fault_prints_as_its_text() -> None:
    fault = Fault(FaultCode.SONAR_STALE, "sonar front has given no range for 250 ms", "front")
    assert str(fault) == f"{fault}" == fault.text
    assert (fault.code, fault.part) == (25, "front")
