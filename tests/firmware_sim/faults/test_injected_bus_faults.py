"""Faults of the bus, the host and frames against the standards, seen on the bus."""

from __future__ import annotations

import numpy as np
import pytest
from e2e import p01

from firmware_sim.bus.errors import ErrorState
from firmware_sim.errors import SimulationError
from tests.firmware_sim.faults.fault_bench import COMMAND, FEEDBACK, MS, SONAR_A, Bench


class TestBus:
    @pytest.mark.parametrize("line", ["bus_cut", "bus_short", "host_cut", "node_cut node=drive"])
    def test_no_feedback_comes_through_a_broken_wire_and_it_does_afterwards(self, driving, line):
        driving.begin(f"{line} duration=0.2")
        driving.drive(0.19)
        assert not driving.of(FEEDBACK)
        assert bool(driving.of(SONAR_A)) == line.startswith("node_cut")
        driving.drive(0.3)
        driving.drive(0.2)
        assert driving.of(SONAR_A)

    def test_a_host_that_breaks_its_frames_goes_bus_off_and_comes_back(self, driving):
        driving.begin("host_bus_off duration=0.2")
        driving.drive(0.19)
        assert driving.port.statistics.bus_offs >= 1
        assert not driving.on_wire(COMMAND)
        assert driving.of(SONAR_A)
        driving.drive(0.1)
        assert driving.port.state is ErrorState.ERROR_ACTIVE
        assert driving.on_wire(COMMAND)

    def test_a_node_goes_bus_off_after_32_broken_frames(self, driving):
        driving.begin("node_bus_off node=power duration=0.15")
        port = next(each for each in driving.simulation.bus.ports if each.name == "power")
        while not port.statistics.bus_offs:
            driving.drive(0.005)
        # From 0, TEC grows by 8 with each broken frame and passes 255 with the 32nd.
        assert port.statistics.errors == 32
        assert driving.port.counters.tec == 0

    @pytest.mark.parametrize(
        ("line", "name", "identifier"),
        [("host_error_passive", "host", COMMAND), ("node_error_passive", "drive", FEEDBACK)],
    )
    def test_an_error_passive_node_stays_so_and_its_frames_get_through(
        self, driving, line, name, identifier
    ):
        driving.begin(line)
        driving.drive(0.05)
        port = next(each for each in driving.simulation.bus.ports if each.name == name)
        states = []
        for _ in range(100):
            driving.drive(0.005)
            states.append(port.state)
            assert len(driving.on_wire(identifier)) in (0, 1, 2)
        assert set(states) == {ErrorState.ERROR_PASSIVE}
        assert port.statistics.bus_offs == 0
        driving.drive(0.5)
        assert len(driving.on_wire(identifier)) == pytest.approx(100, abs=2)
        driving.clear()
        driving.drive(1.0)  # each frame that gets through takes one off the counter
        assert port.state is ErrorState.ERROR_ACTIVE

    def test_without_acknowledgement_the_host_is_error_passive_and_never_bus_off(self, driving):
        driving.begin("no_ack duration=0.5")
        driving.drive(0.4)
        assert not driving.on_wire(COMMAND)
        assert driving.port.state is ErrorState.ERROR_PASSIVE
        assert driving.port.counters.tec == 128
        assert driving.of(SONAR_A)
        driving.drive(0.5)
        driving.drive(0.1)
        assert driving.on_wire(COMMAND)

    @pytest.mark.parametrize("first", ["no_ack", "overload"])
    def test_without_acknowledgement_a_stranger_gives_none_whichever_comes_first(
        self, driving, first
    ):
        second = {"no_ack": "overload", "overload": "no_ack"}[first]
        driving.begin(f"{first} duration=0.5")
        driving.run(1)
        driving.begin(f"{second} duration=0.5")
        driving.drive(0.4)
        assert not driving.on_wire(COMMAND)
        assert driving.port.counters.tec == 128

    def test_a_node_that_boots_meanwhile_does_not_acknowledge_either(self, driving):
        driving.begin("no_ack duration=0.5")
        driving.drive(0.1)
        driving.begin("node_reset node=drive")
        driving.drive(0.3)
        assert not driving.on_wire(COMMAND)

    def test_a_stranger_alone_does_not_acknowledge_the_host(self, driving):
        driving.begin("overload load=0.3 duration=0.5")
        driving.begin("node_cut node=drive duration=0.5")
        driving.begin("node_cut node=sonar duration=0.5")
        driving.begin("node_cut node=power duration=0.5")
        driving.run(10)
        driving.wire.clear()
        driving.drive(0.3)
        assert not driving.on_wire(COMMAND)
        assert driving.port.counters.tec == 128
        assert driving.of(0x7FF), "the host acknowledges the stranger"

    def test_babble_of_identifier_0_leaves_nothing_for_others(self, driving):
        driving.begin("babble node=sonar duration=0.2")
        driving.drive(0.19)
        assert {frame.arbitration_id for frame in driving.wire} == {0}
        driving.drive(0.3)
        driving.drive(0.1)
        assert driving.of(FEEDBACK)

    @pytest.mark.parametrize("load", [0.3, 0.9])
    def test_a_stranger_fills_the_share_that_is_asked_for(self, bench, load):
        bench.run(100)
        bench.begin(f"overload load={load} duration=1")
        bench.frames.clear()
        bench.run(990)
        # 0x7FF with eight zero bytes: 108 bits, 13 stuffed in the zeros, 3 between frames.
        [bits] = {round(s.bits / s.frames) for i, s in bench.simulation.bus.statistics.ids.items()
                  if i == 0x7FF}  # fmt: skip
        assert 108 < bits < 135
        assert len(bench.of(0x7FF)) * bits * 1e-6 / 0.99 == pytest.approx(load, rel=0.02)
        bench.run(11)
        bench.frames.clear()
        bench.run(100)
        assert not bench.of(0x7FF)
        assert len(bench.simulation.bus.ports) == 4

    def test_an_overload_behind_all_others_costs_them_no_frame(self, driving):
        driving.begin("overload priority=low load=1 duration=2.5")
        driving.drive(2.4)
        assert len(driving.of(FEEDBACK)) == 480
        assert driving.simulation.bus.load() > 0.99

    def test_an_overload_before_all_others_leaves_them_nothing(self, driving):
        driving.begin("overload priority=high load=1 duration=0.3")
        driving.drive(0.29)
        assert not driving.of(FEEDBACK)
        assert {f.arbitration_id for f in driving.wire[5:]} == {0x002}


class TestTheHost:
    @pytest.mark.parametrize(
        ("tools", "name"),
        [(("host",), "host#2"), (("bridge:vcan0", "host"), "host#2"), (("host",), "controller")],
    )
    def test_a_fault_of_the_host_befalls_the_port_that_commands_the_motors(self, tools, name):
        bench = Bench(tools=tools, name=name)
        bench.drive(0.1)
        for tool in bench.tools:
            tool.send(0x601, b"\x40\x18\x10\x03")
        bench.begin("host_bus_off duration=0.1")
        bench.drive(0.09)
        assert bench.port.statistics.bus_offs >= 1
        assert [tool.statistics.bus_offs for tool in bench.tools] == [0] * len(tools)

    def test_a_node_that_masquerades_is_not_taken_for_the_host(self, bench):
        bench.begin("masquerade duration=0.1")
        bench.run(50)
        bench.begin("host_cut duration=0.1")
        bench.drive(0.04)
        assert not bench.of(FEEDBACK) + bench.of(SONAR_A)

    @pytest.mark.parametrize("commands", [True, False])
    def test_where_several_could_be_the_host_the_fault_is_refused_and_they_are_named(
        self, commands
    ):
        bench = Bench(tools=("host",), name="host#2")
        if commands:
            bench.command()
            bench.tools[0].send(COMMAND, bytes(8))
            bench.run(5)
        with pytest.raises(SimulationError, match="host, host#2 could be the host"):
            bench.begin("host_cut")

    def test_without_a_host_its_fault_is_refused(self, bench):
        bench.port.detach()
        bench.begin("overload")
        with pytest.raises(SimulationError, match="no host is on the bus"):
            bench.begin("host_cut")


class TestFrames:
    def test_destroyed_frames_are_sent_again_until_they_get_through(self, driving):
        driving.begin("frames_destroyed id=0x181 probability=0.3 duration=0.5")
        driving.drive(0.49)
        assert len(driving.of(FEEDBACK)) == 98
        assert sum(driving.simulation.bus.statistics.errors.values()) > 20

    def test_a_corrupt_frame_differs_in_one_bit_and_fails_its_crc(self, driving):
        driving.begin("frames_corrupt id=0x181 duration=0.5")
        driving.drive(0.49)
        assert len(driving.of(FEEDBACK)) == 98
        for frame in driving.of(FEEDBACK):
            data = bytearray(frame.data)
            assert not p01.e2e_p01_check(data, 0xA181, length=8)
            flips = [
                p01.e2e_p01_check(bytearray((int.from_bytes(frame.data, "little") ^ 1 << b)
                                            .to_bytes(8, "little")), 0xA181, length=8)
                for b in range(64)
            ]  # fmt: skip
            assert sum(map(bool, flips)) >= 1

    def test_lost_frames_are_on_the_wire_but_reach_nobody(self, driving):
        driving.begin("frames_lost id=0x181 duration=0.3")
        driving.drive(0.29)
        assert len(driving.on_wire(FEEDBACK)) == 58
        assert not driving.of(FEEDBACK)

    def test_repeated_frames_come_in_equal_pairs(self, driving):
        driving.begin("frames_repeated id=0x181 duration=0.3")
        driving.drive(0.29)
        data = [frame.data for frame in driving.of(FEEDBACK)]
        assert len(data) == 116
        assert data[::2] == data[1::2]

    def test_a_stale_frame_is_the_last_true_one_again(self, driving):
        driving.drive(0.05)
        driving.begin("frames_stale id=0x181 duration=0.3")
        driving.drive(0.29)
        data = [frame.data for frame in driving.of(FEEDBACK)]
        assert len(data) == 58
        assert set(data) == {data[0]}
        driving.drive(0.1)
        assert len({frame.data for frame in driving.of(FEEDBACK)}) >= 17

    def test_reordered_frames_come_in_swapped_pairs(self, driving):
        driving.begin("frames_reordered id=0x181 duration=0.3")
        driving.drive(0.28)
        stamps = driving.stamps_us()
        assert len(stamps) == 56
        assert np.all(stamps[::2] - stamps[1::2] == pytest.approx(5000, abs=1000))
        assert np.all(np.diff(np.sort(stamps)) == pytest.approx(5000, abs=1000))

    def test_late_frames_come_so_much_later(self, driving):
        driving.begin("frames_late id=0x181 delay=0.012 duration=0.3")
        driving.drive(0.25)
        syncs = [frame.stamp_ns for frame in driving.on_wire(0x080)]
        late = [frame.stamp_ns for frame in driving.of(FEEDBACK)]
        assert (late[0] - syncs[0]) / MS == pytest.approx(12.15, abs=0.1)

    def test_the_drive_takes_no_command_of_a_masquerader(self, bench):
        bench.run(50)
        bench.begin("masquerade duration=0.5")
        bench.run(500)
        assert len(bench.on_wire(COMMAND)) == pytest.approx(100, abs=2)
        assert not bench.simulation.plant.powered
        assert bench.read(1, 0x2100, 1) == 0
        assert bench.read(1, 0x2100, 2) == pytest.approx(100, abs=2)
