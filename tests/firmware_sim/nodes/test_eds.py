"""configs/motor_controller.eds is the truth about the drive's object dictionary."""

from __future__ import annotations

from configparser import RawConfigParser
from pathlib import Path

import canopen
import pytest
from canopen.objectdictionary import ODVariable

from firmware_sim.nodes.drive_objects import drive_objects
from firmware_sim.nodes.variables import Kind
from firmware_sim.simulation import Simulation

CONFIGS = Path(__file__).parents[3] / "configs"
EDS = CONFIGS / "motor_controller.eds"


@pytest.fixture(scope="module")
def eds():
    return canopen.import_od(str(EDS), node_id=1)


@pytest.fixture(scope="module")
def sections():
    parser = RawConfigParser(inline_comment_prefixes=(";",))
    parser.optionxform = str
    parser.read(EDS)
    return parser


def eds_variables(eds):
    for index in eds:
        found = eds[index]
        members = [found] if isinstance(found, ODVariable) else found.values()
        for each in members:
            yield (each.index, each.subindex), each


def test_eds_and_firmware_have_the_same_variables_types_rights_and_defaults(eds):
    ours = {v.key: v for each in drive_objects() for v in each.variables}
    theirs = dict(eds_variables(eds))
    assert theirs.keys() == ours.keys()
    for key, variable in ours.items():
        described = theirs[key]
        assert described.name == variable.name, key
        assert described.data_type == variable.data_type, key
        assert described.access_type == variable.access, key
        assert described.default == variable.default, key
        assert (described.min, described.max) == (variable.low, variable.high), key
        assert described.pdo_mappable == variable.mappable, key


def test_the_drive_of_the_default_robot_is_the_one_in_the_eds(eds):
    simulation = Simulation(CONFIGS / "diff_drive.toml", CONFIGS / "worlds" / "empty_room.toml")
    ours = {v.key: v.default for each in simulation.drive.dictionary for v in each.variables}
    assert ours == {key: variable.default for key, variable in eds_variables(eds)}


def test_eds_and_firmware_have_the_same_kinds_of_object(sections):
    for each in drive_objects():
        section = sections[f"{each.index:04X}"]
        assert section["ParameterName"] == each.name
        assert int(section["ObjectType"], 0) == each.kind
        if each.kind is not Kind.VAR:
            assert int(section["SubNumber"], 0) == len(each.variables)


def test_the_object_lists_of_the_eds_name_each_object_once(sections):
    listed = []
    for name, low, high in (
        ("MandatoryObjects", 0x1000, 0x1FFF),
        ("OptionalObjects", 0x1000, 0x1FFF),
        ("ManufacturerObjects", 0x2000, 0x5FFF),
    ):
        entries = [int(value, 0) for key, value in sections[name].items() if key.isdigit()]
        assert int(sections[name]["SupportedObjects"]) == len(entries)
        assert all(low <= index <= high for index in entries)
        listed += entries
    assert sorted(listed) == sorted(each.index for each in drive_objects())
    assert {0x1000, 0x1001, 0x1018} <= set(listed)


def test_the_mapped_objects_exist_with_the_mapped_length(eds):
    for mapping in (0x1600, 0x1A00, 0x1A01, 0x1A02):
        entry = eds[mapping][1].default
        target = eds[entry >> 16]
        assert target.pdo_mappable
        assert entry & 0xFF == len(target) == 64
