"""docs/safety.md tells the defaults that are in the code."""

import re
from dataclasses import Field, fields
from pathlib import Path

from robotctl.safety.plausibility_config import PlausibilityConfig
from robotctl.safety.state_machine import SafetyConfig

DOCUMENT = Path(__file__).parents[2] / "docs" / "safety.md"
ROW = re.compile(r"^\| `(safety|plausibility)\.(\w+)` \| (.*?) \|", re.MULTILINE)
TOLD = {(section, key): told for section, key, told in ROW.findall(DOCUMENT.read_text("utf-8"))}
SECTIONS = {"safety": SafetyConfig, "plausibility": PlausibilityConfig}


def default(field: Field) -> str:
    return "none, measure" if field.default is None else str(field.default)


def test_every_limit_stands_in_the_table_with_its_default() -> None:
    in_the_code = {
        (section, field.name): default(field)
        for section, config in SECTIONS.items()
        for field in fields(config)
    }
    assert in_the_code == TOLD
