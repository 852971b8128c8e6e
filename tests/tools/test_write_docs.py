"""The pages show the machine that runs, the limits that hold and the faults that there are."""

import re
import tomllib

import pytest

from firmware_sim.config.config import load_robot
from firmware_sim.faults.catalogue import CATALOGUE
from firmware_sim.faults.faults import check
from firmware_sim.faults.scenario import load_scenario
from robotctl.config.robot_file import find_file
from robotctl.mavlink.services.registry import SERVICES
from robotctl.messages.control import SafetyState
from robotctl.safety.plausibility_config import PlausibilityConfig
from robotctl.safety.state_machine import TRANSITIONS, SafetyConfig
from write_docs import BEGIN, END, FAULTS, MICROSERVICES, STATES, TABLE, diagram, microservices

SAFETY = STATES.page.read_text(encoding="utf-8")
FAULTS_PAGE = FAULTS.page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "part", [STATES, FAULTS, MICROSERVICES, TABLE], ids=lambda part: part.page.name
)
def test_the_page_shows_what_is_present(part):
    text = part.page.read_text(encoding="utf-8")
    assert part.put_into(text) == text, "run .venv/bin/python tools/write_docs.py"


@pytest.mark.parametrize("text", ["no marks", BEGIN, f"{BEGIN}{END}{BEGIN}"])
def test_a_page_without_its_marks_is_refused(text):
    with pytest.raises(ValueError, match="once each"):
        FAULTS.put_into(text)


def test_every_microservice_has_its_row_with_all_that_it_says():
    header, _, *rows = (line.split("|")[1:-1] for line in microservices().splitlines())
    assert [row[0].strip() for row in rows] == [service.__name__ for service in SERVICES]
    by_name = {row[0].strip(): dict(zip(header, row, strict=True)) for row in rows}
    assert by_name["Arming"][" answers "] == (
        " DO_FLIGHTTERMINATION, COMPONENT_ARM_DISARM, RUN_PREARM_CHECKS "
    )
    assert by_name["Poses"][" sends "].startswith(" ATTITUDE, LOCAL_POSITION_NED, ODOMETRY")
    assert by_name["GroundStations"][" takes "] == " HEARTBEAT "
    assert by_name["AutopilotVersion"][" capability "] == " MAVLINK2 "


def test_every_transition_is_an_arrow_and_every_arrow_a_transition():
    arrows = re.findall(r"^    (\w+) --> (\w+): (.*)$", diagram(), re.MULTILINE)
    drawn = {(state, event, new) for state, new, events in arrows for event in events.split(" / ")}
    wanted = {(old.name, event.value, new.name) for (old, event), new in TRANSITIONS.items()}
    assert drawn == wanted
    assert f"[*] --> {SafetyState.BOOT.name}\n" in diagram()


@pytest.mark.parametrize(
    ("section", "config"),
    [("safety", SafetyConfig()), ("plausibility", PlausibilityConfig(1.0, 1.0))],
)
def test_the_page_states_each_limit_with_its_default(section, config):
    rows = dict(re.findall(rf"^\| `{section}\.(\w+)` \| ([^|]*) \|", SAFETY, re.MULTILINE))
    fields = type(config).__dataclass_fields__
    assert set(rows) == set(fields)
    for name in fields:
        if name in ("resistance_ohm", "back_emf_v_s_rad"):
            assert rows[name] == "none, measure"
        else:
            assert float(rows[name]) == getattr(config, name), name


def test_every_kind_has_a_row_with_all_its_parameters_and_no_other_has():
    rows = dict(re.findall(r"^\| `(\w+)` \| .* \| (.*) \|$", FAULTS_PAGE, re.MULTILINE))
    assert set(rows) == set(CATALOGUE)
    for name, kind in CATALOGUE.items():
        defaults = re.findall(r"`(\w+)=([^`]*)`", rows[name])
        assert [key for key, _ in defaults] == list(kind.parameters)
        assert check(name, dict(defaults))[1] == kind.complete({})


def test_the_examples_of_the_page_are_right(tmp_path):
    [example] = re.findall(r"```toml\n(.*?)```", FAULTS_PAGE, re.DOTALL)
    assert len(tomllib.loads(example)["fault"]) == 2
    path = tmp_path / "example.toml"
    path.write_text(example, encoding="utf-8")
    load_scenario(path, load_robot(find_file("diff_drive")))
    for line in re.search(r"```\n(encoder.*?)clear\n```", FAULTS_PAGE, re.DOTALL)[1].splitlines():
        name, *words = line.split()
        check(name, dict(word.split("=") for word in words))
