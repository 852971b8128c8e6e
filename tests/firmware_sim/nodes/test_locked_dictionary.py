"""Nothing of an object dictionary can be written while the motors are enabled."""

from __future__ import annotations

import re
from pathlib import Path

import canopen
import pytest
from canopen.objectdictionary import ODVariable

from firmware_sim.nodes.power import BatterySample, PowerNode
from firmware_sim.nodes.sonar import SonarNode
from firmware_sim.simulation import Simulation
from tests.firmware_sim.nodes.conftest import Host

ROOT = Path(__file__).parents[3]
CONFIGS = ROOT / "configs"
EDS = CONFIGS / "motor_controller.eds"
DEVICE_STATE = bytes.fromhex("22000008")
SAVE, LOAD = 0x65766173, 0x64616F6C
SIZES = {5: 1, 6: 2, 7: 4}


def objects_of_the_eds():
    dictionary = canopen.import_od(str(EDS), node_id=1)
    for index in dictionary:
        found = dictionary[index]
        yield from [found] if isinstance(found, ODVariable) else found.values()


def value_for(variable):
    special = {0x1010: SAVE, 0x1011: LOAD, 0x1003: 0}
    return special.get(variable.index, variable.min if variable.min is not None else 1)


WRITABLE = [
    pytest.param(v.index, v.subindex, value_for(v), SIZES[v.data_type], id=f"{v.index:04X}")
    for v in objects_of_the_eds()
    if v.access_type in {"rw", "wo"} and v.data_type in SIZES
]
"""All but the image of MotorCommand, which is refused always."""
READ_ONLY = [
    pytest.param(v.index, v.subindex, id=f"{v.index:04X}sub{v.subindex}")
    for v in objects_of_the_eds()
    if v.access_type in {"ro", "const"}
]


def test_the_list_is_not_empty():
    assert {each.id for each in WRITABLE} >= {"1010", "1017", "1801", "2000", "2003", "2010"}


@pytest.mark.parametrize(("index", "sub", "value", "size"), WRITABLE)
def test_a_drive_takes_a_write_when_it_is_ready_and_refuses_it_when_enabled(
    rig, index, sub, value, size
):
    rig.enable()
    answer = rig.write(index, sub, value, size)
    assert answer[0] == 0x80
    assert answer[1:4] == index.to_bytes(2, "little") + bytes((sub,))
    assert answer[4:] == DEVICE_STATE
    rig.host.send(enable=False)
    assert rig.write(index, sub, value, size)[0] == 0x60


@pytest.mark.parametrize(("index", "sub"), READ_ONLY)
@pytest.mark.parametrize("enabled", [False, True])
def test_what_is_fixed_is_refused_as_read_only_always(rig, index, sub, enabled):
    if enabled:
        rig.enable()
    answer = rig.write(index, sub, 1, 1)
    assert answer[0] == 0x80
    assert int.from_bytes(answer[4:], "little") == 0x06010002


def test_a_segmented_write_that_began_before_is_refused_too(rig):
    assert rig.sdo(bytes.fromhex("2100200002000000"))[0] == 0x60
    rig.enable()
    assert rig.sdo(bytes.fromhex("0bd0070000000000"))[4:] == DEVICE_STATE
    assert rig.read(0x2000) == 100


def test_a_refused_write_changes_nothing_about_the_stop(rig):
    rig.host.send(enable=False)
    rig.host.drive(100, enable=True)
    assert rig.write(0x2000, 0, 2000, 2)[4:] == DEVICE_STATE
    rig.host.drive(100, enable=True)
    rig.line.run_ms(94)  # the last command is 5 ms old
    assert rig.drive.drive_state.name == "ENABLED"
    rig.line.run_ms(2)
    assert rig.drive.drive_state.name == "STOPPED"
    assert rig.read(0x2000) == 100


def nodes(line):
    line.add(SonarNode(8, 4.0, lambda group, now_ns: (1.0, 1.0, 1.0, 1.0)))
    line.add(PowerNode(lambda now_ns: BatterySample(12.0, 1.0, 0.9, 25.0), 3))
    line.start_all()


def write(line, node, index, value):
    before = len(line.sent)
    request = b"\x2b" + index.to_bytes(2, "little") + b"\0" + value.to_bytes(4, "little")
    line.deliver(0x600 + node, request)
    [answer] = [f.data for f in line.sent[before:] if f.arbitration_id == 0x580 + node]
    return answer


@pytest.mark.parametrize(
    ("node", "index"), [(2, 0x2201), (2, 0x1017), (3, 0x2300), (3, 0x2301), (3, 0x1017)]
)
def test_the_other_nodes_refuse_while_they_hear_that_the_motors_are_told_to_turn(
    line, database, node, index
):
    nodes(line)
    host = Host(line, database)
    assert write(line, node, index, 100)[0] == 0x60
    host.drive(100, enable=True)
    assert write(line, node, index, 200)[4:] == DEVICE_STATE
    line.run_ms(480)
    assert write(line, node, index, 200)[4:] == DEVICE_STATE
    line.run_ms(20)
    assert write(line, node, index, 200)[0] == 0x60, "the host is away"
    host.drive(100, enable=True)
    assert write(line, node, index, 100)[4:] == DEVICE_STATE
    host.drive(5, enable=False)
    assert write(line, node, index, 100)[0] == 0x60


def test_every_object_stands_in_the_table_of_the_documentation():
    simulation = Simulation(CONFIGS / "diff_drive.toml", CONFIGS / "worlds" / "empty_room.toml")
    text = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
    section = text.partition("## What others may change on the bus")[2].partition("\n## ")[0]
    rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| 0x")]
    told = set()
    for row in rows:
        numbers = [int(each, 16) for each in re.findall(r"0x([0-9A-F]{4})", row)]
        told.update(numbers)
        for low, high in re.findall(r"0x([0-9A-F]{4}) to 0x([0-9A-F]{4})", row):
            told.update(range(int(low, 16), int(high, 16) + 1))
    for node in simulation.nodes:
        for each in node.dictionary:
            assert each.index in told, f"{node.name}: 0x{each.index:04X} {each.name}"
