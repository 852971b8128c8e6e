"""A simulated robot on two buses: who hears whom, in which order, at which bit rates."""

import pytest

from firmware_sim.bus.faults import Cut
from firmware_sim.bus.frame import BIT_RATE_SWITCH_FLAG, FD_FLAG
from firmware_sim.config.config import load_robot
from firmware_sim.errors import SimulationError
from firmware_sim.faults.scenario import load_scenario, play
from firmware_sim.simulation import Simulation
from robotctl.config.robot_file import find_file

MS = 1_000_000
CAN = '[can]\ninterface = "socketcan"\nchannel = "can0"\nbitrate = 1_000_000\n'
TWO = """[[can]]
channel = "can0"

[[can]]
name = "sensors"
channel = "can1"
bitrate = 250_000

[nodes]
sonar = "sensors"
"""
HEARTBEATS = {"drive": 0x701, "sonar": 0x702, "power": 0x703}


@pytest.fixture
def robot_file(tmp_path):
    """Write diff_drive.toml with other buses."""

    def write(buses, **replacements):
        text = find_file("diff_drive").read_text()
        assert CAN in text
        text = text.replace(CAN, buses)
        for old, new in replacements.items():
            text = text.replace(old, new)
        path = tmp_path / "robot.toml"
        path.write_text(text)
        return path

    return write


@pytest.fixture
def make(robot_file):
    def make(buses=TWO, **options):
        robot = load_robot(robot_file(buses), options.pop("overrides", None))
        return Simulation(robot, find_file("empty_room", "worlds"), seed=1, **options)

    return make


def listen(simulation):
    """What is heard on each bus, with the name of the bus, in the order of its coming."""
    heard = []
    for name, bus in simulation.buses.items():
        bus.tap(lambda frame, name=name: heard.append((frame.stamp_ns, name, frame.arbitration_id)))
    return heard


def test_each_node_is_on_its_bus_at_the_bit_rate_of_that(make):
    simulation = make()
    heard = listen(simulation)
    simulation.buses["sensors"].attach("host", lambda frame: None)
    simulation.bus.attach("host", lambda frame: None)
    simulation.advance(1000 * MS)
    beats = {(name, can_id) for _, name, can_id in heard if can_id in HEARTBEATS.values()}
    assert beats == {("main", 0x701), ("main", 0x703), ("sensors", 0x702)}
    assert [bus.bitrate for bus in simulation.buses.values()] == [1_000_000, 250_000]
    assert simulation.truth().bus_frames == len(heard)


def test_frames_of_all_buses_come_in_the_order_of_time(make):
    simulation = make()
    heard = listen(simulation)
    hosts = [bus.attach("host", lambda frame: None) for bus in simulation.buses.values()]
    for tick in range(200):
        simulation.advance(tick * 5 * MS)
        for host in hosts:
            host.send(0x080)
    stamps = [stamp_ns for stamp_ns, _, _ in heard]
    assert len(stamps) > 400
    assert stamps == sorted(stamps)
    assert {name for _, name, _ in heard} == {"main", "sensors"}


def test_the_size_of_the_steps_changes_nothing(make):
    def run(step_ns):
        simulation = make()
        heard = listen(simulation)
        for bus in simulation.buses.values():
            bus.attach("host", lambda frame: None)
        while simulation.now_ns < 300 * MS:
            simulation.advance(min(simulation.now_ns + step_ns, 300 * MS))
        return sorted(heard)

    assert run(300 * MS) == run(777_777)


def test_a_robot_with_one_bus_in_a_list_is_that_of_a_single_table(make):
    def run(buses):
        simulation = make(buses)
        heard = listen(simulation)
        simulation.bus.attach("host", lambda frame: None)
        simulation.advance(300 * MS)
        return heard

    assert run(CAN) == run(CAN.replace("[can]", "[[can]]"))


def test_a_cut_bus_silences_its_own_nodes_only(make):
    simulation = make()
    heard = listen(simulation)
    for bus in simulation.buses.values():
        bus.attach("host", lambda frame: None)
    simulation.advance(300 * MS)
    simulation.buses["sensors"].inject(Cut(start_ns=simulation.now_ns))
    heard.clear()
    simulation.advance(600 * MS)
    assert {name for _, name, can_id in heard if can_id < 0x800} == {"main"}


def test_a_fault_of_a_node_finds_it_on_its_bus(make, tmp_path, robot_file):
    scenario = tmp_path / "mute.toml"
    scenario.write_text("[[fault]]\nkind = 'node_cut'\nat = 0.3\nduration = 0.3\nnode = 'sonar'\n")
    simulation = make()
    heard = listen(simulation)
    for bus in simulation.buses.values():
        bus.attach("host", lambda frame: None)
    play(load_scenario(scenario, simulation.config), simulation.faults, lambda line: None)
    simulation.advance(1000 * MS)
    beats = [stamp_ns for stamp_ns, name, can_id in heard if can_id == HEARTBEATS["sonar"]]
    assert not [each for each in beats if 300 * MS < each < 600 * MS]
    assert [each for each in beats if each < 300 * MS]
    assert [each for each in beats if each > 600 * MS]


def test_a_bus_of_can_fd_carries_its_frames_unless_a_node_is_classic(make):
    buses = CAN + "data_bitrate = 5_000_000\n"

    def errors(classic):
        simulation = make(buses, overrides={"simulation.classic_nodes": classic})
        host = simulation.bus.attach("host", lambda frame: None)
        simulation.bus.attach("other", lambda frame: None)
        simulation.advance(50 * MS)
        host.send(0x400 | FD_FLAG | BIT_RATE_SWITCH_FLAG, bytes(64))
        simulation.advance(60 * MS)
        assert host.statistics.sent == 1
        return simulation.truth().bus_errors

    assert errors([]) == 0
    assert errors(["power"]) == 15


@pytest.mark.parametrize(
    ("buses", "overrides", "said"),
    [
        (TWO.replace("sonar =", "sona ="), {}, "nodes: no node 'sona'; did you mean \"sonar\"?"),
        (TWO.replace('sonar = "sensors"', 'sonar = "x"'), {}, "no bus 'x'"),
        (TWO.replace('name = "sensors"\n', ""), {}, "each bus must have a name of its own"),
        (
            CAN,
            {"simulation.classic_nodes": ["pow"]},
            "simulation.classic_nodes: no node 'pow'; did you mean \"power\"?",
        ),
    ],
)
def test_buses_that_do_not_fit_are_refused(make, buses, overrides, said):
    with pytest.raises(SimulationError) as refused:
        make(buses, overrides=overrides)
    assert said in str(refused.value)
