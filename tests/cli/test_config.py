"""`robotctl config schema`: a schema of robots' files in which each key says what it means."""

import json
import tomllib
from collections.abc import Iterator

import jsonschema
import pytest

from robotctl.cli.config import schema
from robotctl.config.robot_file import find_file


@pytest.fixture
def printed(capsys):
    schema()
    return json.loads(capsys.readouterr().out)


def numbers(whole) -> Iterator[tuple[str, dict]]:
    for name, table in whole["$defs"].items():
        for key, entry in table.get("properties", {}).items():
            if entry.get("type") in {"number", "integer"}:
                yield f"{name}.{key}", entry


def test_every_number_says_what_it_means(printed):
    silent = [name for name, entry in numbers(printed) if not entry.get("description")]
    assert silent == []
    gate = printed["$defs"]["TracksConfig"]["properties"]["gate_m"]
    assert gate["description"].endswith("[m], 0.01 to 5.")
    assert printed["$defs"]["TracksConfig"]["description"].count("\n") == 0


@pytest.mark.parametrize("robot", ["tricycle", "ackermann", "mecanum"])
def test_files_of_robots_fit_the_schema_and_others_do_not(printed, robot):
    file = tomllib.loads(find_file(robot).read_text())
    jsonschema.validate(file, printed)
    file["navigation"] = {"map": {"tracks": {"gate_m": "near"}}}
    with pytest.raises(jsonschema.ValidationError, match="near"):
        jsonschema.validate(file, printed)
