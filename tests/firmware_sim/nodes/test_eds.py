"""The EDS of drive and IMU in `configs/` are the truth about their object dictionaries."""

from __future__ import annotations

from configparser import RawConfigParser
from pathlib import Path

import canopen
import pytest
from canopen.objectdictionary import ODVariable

from firmware_sim.nodes.drive_objects import drive_objects
from firmware_sim.nodes.imu import imu_objects
from firmware_sim.nodes.variables import Kind
from firmware_sim.simulation import Simulation

CONFIGS = Path(__file__).parents[3] / "configs"
EDS = CONFIGS / "motor_controller.eds"
OBJECTS = {EDS: drive_objects(), CONFIGS / "imu.eds": imu_objects()}
FILES = pytest.mark.parametrize("file", OBJECTS, ids=lambda file: file.name)


@pytest.fixture(scope="module")
def eds():
    return canopen.import_od(str(EDS), node_id=1)


def read_sections(file):
    parser = RawConfigParser(inline_comment_prefixes=(";",))
    parser.optionxform = str
    parser.read(file)
    return parser


def eds_variables(eds):
    for index in eds:
        found = eds[index]
        members = [found] if isinstance(found, ODVariable) else found.values()
        for each in members:
            yield (each.index, each.subindex), each


@FILES
def test_eds_and_firmware_have_the_same_variables_types_rights_and_defaults(file):
    ours = {v.key: v for each in OBJECTS[file] for v in each.variables}
    theirs = dict(eds_variables(canopen.import_od(str(file), node_id=1)))
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


@FILES
def test_eds_and_firmware_have_the_same_kinds_of_object(file):
    sections = read_sections(file)
    for each in OBJECTS[file]:
        section = sections[f"{each.index:04X}"]
        assert section["ParameterName"] == each.name
        assert int(section["ObjectType"], 0) == each.kind
        if each.kind is not Kind.VAR:
            assert int(section["SubNumber"], 0) == len(each.variables)


@FILES
def test_the_object_lists_of_the_eds_name_each_object_once(file):
    sections = read_sections(file)
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
    assert sorted(listed) == sorted(each.index for each in OBJECTS[file])
    assert {0x1000, 0x1001, 0x1018} <= set(listed)


def test_the_mapped_objects_exist_with_the_mapped_length(eds):
    for mapping in (0x1600, 0x1A00, 0x1A01, 0x1A02):
        entry = eds[mapping][1].default
        target = eds[entry >> 16]
        assert target.pdo_mappable
        assert entry & 0xFF == len(target) == 64
