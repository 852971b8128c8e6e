"""The guided first day with drives of other makes, wired and set otherwise than the file says."""

import pytest

from robotctl.deploy.setup.dialogue import Topic
from robotctl.errors import ConfigError
from tests.deploy.setup.setup_rig import STEP, SetupRig

UNTIL_PROVEN = ("nodes", "counts", "directions", "prove")


def axis(actuator, **keys):
    return {"axes": [{"actuator": actuator, **keys}]}


def two(left, right):
    """Axes 1 and 2 of one drive, as they are in truth."""
    return {"axes": [{"axis": 1, **left}, {"axis": 2, **right}]}


WRONG = {
    # Four wheels: two swapped, one of them with another gear, one reversed, one number wrong.
    "skid_steer": {
        "drive_front_left": axis("rear_left"),
        "drive_rear_left": axis("front_left", ratio=2.5),
        "drive_front_right": axis("front_right"),
        "drive_rear_right": {"node_id": 17},
    },
    "vesc_car": {"vesc": {"node_id": 33, "pole_pairs": 7}},
    # Its numbers swapped with a third, and so its wheels; one is geared otherwise.
    "moteus": {
        "moteus_left": {"node_id": 2, **axis("right", ratio=10.0)},
        "moteus_right": {"node_id": 5, **axis("left", ratio=20.0)},
    },
    "zlac8015d": {
        "motors": {
            "node_id": 3,
            **two({"actuator": "right", "reversed": True}, {"actuator": "left"}),
        }
    },
    "cia402": {
        "motors": two(
            {"actuator": "left", "ratio": 15.0},
            {"actuator": "right", "ratio": 15.0},
        )
    },
}


@pytest.mark.parametrize("robot", WRONG)
def test_each_fault_is_found_and_put_right_with_no_wheel_fast_meanwhile(tmp_path, robot):
    rig = SetupRig(tmp_path, robot, WRONG[robot])
    assert rig.run(*UNTIL_PROVEN) == [True] * 4
    true = wheels_of(rig.simulation.config)
    believed = {
        table.get("node_id"): [
            (each["actuator"], each.get("axis", 1), each.get("reversed", False),
             pytest.approx(each.get("ratio", 1.0), rel=0.01))
            for each in table["axes"]
        ]
        for table in rig.tables["motor"]
    }  # fmt: skip
    assert believed == true
    assert set(rig.tables["proof"]) == {table["name"] for table in rig.tables["motor"]}
    x_m, y_m, theta_rad = rig.drive_straight()
    assert x_m > 0.6
    assert abs(y_m) < 0.05
    assert abs(theta_rad) < 0.05


def wheels_of(config):
    """Wheels, axes, senses and ratios of the true drives, by their true numbers."""
    found = {}
    for table in config.motors:
        keys = {**table.keys, **config.simulation.twin.get(table.name, {})}
        found[keys.get("node_id")] = [
            (each["actuator"], each.get("axis", 1), each.get("reversed", False),
             each.get("ratio", 1.0))
            for each in keys["axes"]
        ]  # fmt: skip
    return found


def test_a_wrong_pole_count_is_named_and_the_gear_is_left(tmp_path):
    rig = SetupRig(tmp_path, "vesc_car", {"vesc": {"pole_pairs": 7}})
    assert rig.run("nodes", "counts") == [True, True]
    assert rig.heard("a factor of 3.500 (about 7/2): pole_pairs = 7 instead of 2, or ratio = 77")
    assert (rig.tables["motor"][0]["pole_pairs"], rig.tables["motor"][0]["axes"][0]["ratio"]) == (
        7,
        22.0,
    )


def test_ten_turns_that_are_counted_a_little_short_change_nothing(tmp_path):
    rig = SetupRig(tmp_path, "odrive", {"left_drive": axis("left", ratio=10.1)})
    ratio = rig.tables["motor"][0]["axes"][0]["ratio"]
    assert ratio == 10.0
    assert rig.run("nodes", "counts") == [True, True]
    assert rig.text == rig.before


def test_a_drive_that_answers_by_no_number_is_said(tmp_path):
    rig = SetupRig(tmp_path, "odrive")
    rig.simulation.power_off(rig.simulation.twins[0])
    rig.person.script[Topic.NUMBER] = ["-1"]
    assert rig.run("nodes") == [False]
    assert rig.heard("left_drive (node")
    assert rig.heard("not heard on the bus")
    assert rig.text == rig.before


def test_a_drive_that_runs_on_is_named_and_not_proven(tmp_path):
    silent = {"left_drive": {"firmware": [0, 5, 6], "watchdog_ms": 0.0}}
    rig = SetupRig(tmp_path, "odrive", silent)
    assert rig.run("nodes", "prove") == [True, False]
    assert rig.heard("NOT proven: left_drive keeps running: left has 100% of its speed")
    assert list(rig.tables["proof"]) == ["right_drive"]
    assert rig.guide.done == {"nodes"}
    rig.buses.clock.sleep_until(rig.simulation.now_ns + 100_000_000)
    assert not rig.simulation.plant.powered


def test_a_drive_that_stops_too_late_is_named_and_not_proven(tmp_path):
    late = {"left_drive": {"firmware": [0, 5, 6], "watchdog_ms": 400.0}}
    rig = SetupRig(tmp_path, "odrive", late)
    assert rig.run("nodes", "prove") == [True, False]
    assert rig.heard("NOT proven: left_drive takes the power of left too late")
    assert list(rig.tables["proof"]) == ["right_drive"]


EASY = (("coulomb_n_m = 4.0e-3", "coulomb_n_m = 1.0e-6"),
        ("[simulation.wheels]", "[simulation.wheels]\nrolling_resistance = 0.0"))  # fmt: skip
"""A motor that rolls on for seconds."""


def test_a_drive_that_coasts_is_named_and_proven_only_where_its_table_accepts_it(tmp_path):
    weak = ("brake_current_a = 8.0", "brake_current_a = 0.001")
    rig = SetupRig(tmp_path, "vesc_car", believed=(*EASY, weak))
    assert rig.run("nodes", "prove") == [True, False]
    assert rig.heard("NOT proven: vesc coasts: drive still has")
    assert rig.heard("accept_coasting = true")
    assert "proof" not in rig.tables
    accepted = ("brake_current_a = 8.0", "accept_coasting = true\nbrake_current_a = 0.0")
    (tmp_path / "2").mkdir()
    rig = SetupRig(tmp_path / "2", "vesc_car", believed=(*EASY, accepted))
    assert rig.run("nodes", "prove") == [True, True]
    assert rig.heard("coasts then")
    assert "coasts" in rig.tables["proof"]["vesc"]


def test_the_proof_says_when_the_power_went(tmp_path):
    rig = SetupRig(tmp_path, "odrive")
    assert rig.run("nodes", "prove") == [True, True]
    (line,) = [each for each in rig.text.splitlines() if each.startswith("left_drive = ")]
    lost_ms = float(line.partition("seen: power gone after ")[2].partition(" ms")[0])
    timeout_ms = rig.config.safety.command_timeout_ms
    assert timeout_ms <= lost_ms <= timeout_ms + 100  # a heartbeat later at most


def test_while_ratios_are_not_known_wheels_creep(tmp_path):
    wrong = {"left_drive": axis("left", ratio=2.0), "right_drive": axis("right", ratio=2.0)}
    rig = SetupRig(tmp_path, "odrive", wrong)
    rig.guide.run(STEP["directions"])
    assert 0.1 < rig.buses.fastest_m_s < 0.2  # five times as fast as commanded


def test_a_drive_that_cannot_be_what_the_file_says_is_refused_with_its_name(tmp_path):
    rig = SetupRig(tmp_path, "roboteq")
    text = rig.text
    rig.file.write_text(text.replace("accept_coasting = true", "accept_coasting = false"))
    with pytest.raises(ConfigError, match=r"motor motors: accept_coasting must be true"):
        rig.guide.run(STEP["nodes"])


def test_a_drive_without_a_time_out_is_not_proven_even_where_its_table_accepts_that(tmp_path):
    rig = SetupRig(tmp_path, "roboteq")
    assert rig.run("nodes", "prove") == [True, False]
    assert rig.heard("NOT proven: motors keeps running")
