"""The EDS in `configs/` are the truth about the object dictionaries of the nodes."""

from __future__ import annotations

from configparser import RawConfigParser
from pathlib import Path

import canopen
import cantools
import pytest
from canopen.objectdictionary import ODVariable

from firmware_sim.config.config import load_robot
from firmware_sim.nodes.drive_objects import drive_objects
from firmware_sim.nodes.imu import imu_objects
from firmware_sim.nodes.power import power_objects
from firmware_sim.nodes.sonar import sonar_objects
from firmware_sim.nodes.variables import Kind
from firmware_sim.simulation import Simulation

CONFIGS = Path(__file__).parents[3] / "configs"
EDS = CONFIGS / "motor_controller.eds"
OBJECTS = {
    EDS: drive_objects(),
    CONFIGS / "sonar_ring.eds": sonar_objects(8),
    CONFIGS / "power.eds": power_objects(3),
    CONFIGS / "imu.eds": imu_objects(),
}
NODES = dict(zip(OBJECTS, ("DRIVE", "SONAR", "POWER", "IMU"), strict=True))
"""By the names of robot.dbc, in the order of their node ids from 1 on."""
NODE_ID = {file: number for number, file in enumerate(OBJECTS, 1)}
FILES = pytest.mark.parametrize("file", OBJECTS, ids=lambda file: file.name)
PDOS = range(0x180, 0x580)
MISSING = 1 << 31


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
    theirs = dict(eds_variables(canopen.import_od(str(file), node_id=NODE_ID[file])))
    assert theirs.keys() == ours.keys()
    for key, variable in ours.items():
        described = theirs[key]
        assert described.name == variable.name, key
        assert described.data_type == variable.data_type, key
        assert described.access_type == variable.access, key
        assert described.default == variable.default, key
        assert (described.min, described.max) == (variable.low, variable.high), key
        assert described.pdo_mappable == variable.mappable, key


@FILES
def test_the_nodes_of_the_default_robot_are_those_in_the_eds(file):
    robot = load_robot(CONFIGS / "diff_drive.toml", {"imu.enabled": True})
    simulation = Simulation(robot, CONFIGS / "worlds" / "empty_room.toml")
    (node,) = (each for each in simulation.nodes if each.node_id == NODE_ID[file])
    ours = {v.key: v.default for each in node.dictionary for v in each.variables}
    theirs = canopen.import_od(str(file), node_id=NODE_ID[file])
    assert ours == {key: variable.default for key, variable in eds_variables(theirs)}


def test_every_eds_is_one_of_a_node():
    assert sorted(CONFIGS.glob("*.eds")) == sorted(OBJECTS)


@FILES
def test_canopen_makes_nodes_of_the_eds_whose_pdos_are_the_frames_of_the_dbc(file):
    canopen.LocalNode(NODE_ID[file], str(file))
    node = canopen.Network().add_node(NODE_ID[file], str(file))
    node.tpdo.read(from_od=True)
    found = {}
    for pdo in node.tpdo.values():
        (mapped,) = pdo
        assert (mapped.length, mapped.index in node.object_dictionary) == (64, True)
        found[pdo.cob_id % MISSING] = pdo.enabled
    dbc = cantools.database.load_file(CONFIGS / "robot.dbc")
    sent = {each for each in dbc.messages if NODES[file] in each.senders}
    frames = {each.frame_id for each in sent if each.frame_id in PDOS}
    assert found.keys() == frames
    groups = {0x182, 0x282} if NODES[file] == "SONAR" else frames
    assert {frame for frame, enabled in found.items() if enabled} == groups
    (emergency,) = (each.frame_id for each in sent if 0x80 < each.frame_id < 0x100)
    assert node.object_dictionary[0x1014].default == emergency


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
