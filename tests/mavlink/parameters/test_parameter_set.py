"""The parameters of a robot: its values under MAVLink's names, and when a new one counts."""

import dataclasses
import math
import re
import struct

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from robotctl.app.processes.navigator import make_navigation
from robotctl.app.processes.robot import make_core
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import contradictions, find_file, load_robot
from robotctl.config_values import replaced, value_at, with_values
from robotctl.mavlink.parameters.parameter import INT32, REAL32, Change, shortest, single
from robotctl.mavlink.parameters.parameter_set import (
    Configurations,
    ParamError,
    ParameterRefused,
    ParameterSet,
)
from robotctl.mavlink.parameters.table import PARAMETERS

ROBOTS = {name: load_robot(find_file(name)) for name in ("diff_drive", "tricycle", "ackermann")}
CONFIG = ROBOTS["diff_drive"]


def parameters(began=CONFIG, **wanted):
    """Return the set of the differential-drive robot, and a function that sets by name."""
    values = {key.replace("__", "."): value for key, value in wanted.items()}
    found = ParameterSet(Configurations(CONFIG, began, contradictions), values)

    def put(name, value, kind=None):
        parameter = found.parameters[found.index_of(name)]
        kind = kind or (REAL32 if isinstance(found.value(parameter), float) else INT32)
        return found.set(parameter, single(value), kind)

    return found, put


def refusal(put, *arguments):
    with pytest.raises(ParameterRefused) as found:
        put(*arguments)
    return found.value.problem, str(found.value)


def test_names_are_mavlinks_and_unique():
    names = [each.name for each in PARAMETERS]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch("[A-Z][A-Z0-9_]{0,15}", name) for name in names)
    assert len({each.key for each in PARAMETERS}) == len(names)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_has_the_parameters_that_its_file_has_values_for(name):
    config = ROBOTS[name]
    found = ParameterSet(Configurations(config, config, contradictions), {})
    names = {each.name for each in found.parameters}
    assert ("CTL_L_KP" in names) == (name == "diff_drive")
    assert ("CTL_D_KP" in names) == (name != "diff_drive")
    for index, fact in enumerate(found.facts()):
        parameter = fact.parameter
        assert found.index_of(parameter.name) == index
        assert found.value(parameter) == fact.default == value_at(config, parameter.key)
        assert parameter.low <= fact.default <= parameter.high
        assert fact.description.endswith((".", ","))
    units = {each.parameter.name: each.unit for each in found.facts()}
    assert units["LIM_OMEGA_MAX"] == "rad/s"
    assert units.get("CTL_L_KD", "V s^2/rad") == "V s^2/rad"
    assert units["MON_PAIR_SHARE"] == ""


def test_every_bound_of_the_table_is_allowed_by_the_constructors():
    """What else is wrong with it has to do with other values."""
    for parameter in PARAMETERS:
        value = value_at(CONFIG, parameter.key)
        if value is None or parameter.change is Change.NEVER:
            continue
        for bound in (parameter.low, parameter.high):
            assert value_at(replaced(CONFIG, parameter.key, bound), parameter.key) == bound


@given(st.floats(width=32))
def test_the_shortest_number_is_the_one_that_was_packed(value):
    assume(not math.isnan(value))
    assert struct.pack("<f", shortest(value)) == struct.pack("<f", value)
    assert shortest(single(0.1)) == 0.1


def test_a_value_is_taken_and_kept_as_the_decimal_that_was_meant():
    found, put = parameters()
    assert put("CTL_L_KP", 0.7) == "0.65 -> 0.7"
    assert found.changes() == found.live() == {"control.left.kp": 0.7}
    assert found.now.control.left.kp == 0.7
    assert put("CTL_L_KP", 0.7) == ""
    assert put("CTL_L_KP", 0.65) == "0.7 -> 0.65"
    assert found.changes() == found.live() == {}


def test_what_protects_the_robot_changes_at_once_to_the_safe_side_of_its_start_only():
    found, put = parameters()
    assert put("LIM_V_MAX", 0.5) == "0.8 -> 0.5"
    assert found.live() == {"limits.v_max_m_s": 0.5}
    assert put("LIM_V_MAX", 1.0) == "0.5 -> 1 after a restart, 0.8 until then"
    assert found.live() == {}
    assert found.changes() == {"limits.v_max_m_s": 1.0}
    assert put("GRD_MARGIN", 0.3) == "0.12 -> 0.3"
    assert put("GRD_MARGIN", 0.1) == "0.3 -> 0.1 after a restart, 0.12 until then"
    assert put("SAF_ARM_MS", 2000) == "1000 -> 2000 after a restart, 1000 until then"
    assert found.value(found.parameters[found.index_of("SAF_ARM_MS")]) == 2000


def test_a_robot_that_was_restarted_began_with_the_new_values():
    began, _ = with_values(CONFIG, {"limits.v_max_m_s": 1.0}, contradictions)
    found, put = parameters(began, limits__v_max_m_s=1.0)
    assert found.live() == {}
    assert found.changes() == {"limits.v_max_m_s": 1.0}
    assert put("LIM_V_MAX", 0.9) == "1 -> 0.9"


def test_a_telemetry_that_was_restarted_brings_the_live_values_into_force_again():
    found, _ = parameters(control__left__kp=0.7, limits__v_max_m_s=1.0)
    assert found.live() == {"control.left.kp": 0.7}


def test_what_is_wrong_is_refused_and_said():
    _, put = parameters()
    assert refusal(put, "LIM_V_MAX", math.nan)[0] is ParamError.VALUE_OUT_OF_RANGE
    assert refusal(put, "LIM_V_MAX", math.inf)[0] is ParamError.VALUE_OUT_OF_RANGE
    out = refusal(put, "CTL_L_KP", 101)
    assert out == (ParamError.VALUE_OUT_OF_RANGE, "CTL_L_KP: 101 found, 0 to 100 allowed")
    assert refusal(put, "CTL_L_KP", 1, INT32)[0] is ParamError.TYPE_MISMATCH
    assert refusal(put, "SAF_ARM_MS", 1000.5)[0] is ParamError.TYPE_MISMATCH
    assert refusal(put, "SAF_ARM_MS", 1000, 4)[0] is ParamError.TYPE_UNSUPPORTED
    assert refusal(put, "GEO_TRACK", 0.4)[0] is ParamError.READ_ONLY
    problem, text = refusal(put, "GRD_DECEL", 3.0)
    assert problem is ParamError.VALUE_OUT_OF_RANGE
    assert "limits.a_max_m_s2" in text
    assert put("SAF_ARM_MS", 2000.0, REAL32)  # many send nothing else


def wrong_values(parameter, value):
    """Return values that a parameter, which has a value of its type now, may not take."""
    yield from (math.nan, math.inf, -math.inf, 3e38, -3e38)
    if isinstance(value, bool):
        yield from (-1.0, 2.0, 0.5, 255.0)
    elif isinstance(value, int):
        yield from (parameter.low - 1, parameter.high + 1, parameter.low + 0.5)
    else:
        for bound, away in ((parameter.low, -1.0), (parameter.high, 1.0)):
            yield single(bound) + away * max(1e-3 * abs(bound), 1e-6)


@pytest.mark.parametrize("name", ROBOTS)
def test_each_parameter_refuses_what_is_out_of_its_range(name):
    config = ROBOTS[name]
    found = ParameterSet(Configurations(config, config, contradictions), {})
    for parameter in found.parameters:
        if parameter.change is Change.NEVER:
            continue
        value = found.value(parameter)
        for wrong in wrong_values(parameter, value):
            for kind in {REAL32, REAL32 if isinstance(value, float) else INT32}:
                with pytest.raises(ParameterRefused) as refused:
                    found.set(parameter, wrong, kind)
                assert refused.value.problem in {
                    ParamError.VALUE_OUT_OF_RANGE,
                    ParamError.TYPE_MISMATCH,
                }
                assert str(refused.value).startswith(parameter.name)
    assert found.changes() == {}


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("PUR_LOOK_MIN", 0.7, "0.7 found, at most lookahead_max_m (0.6) allowed"),
        ("PUR_LOOK_MAX", 0.2, "0.25 found, at most lookahead_max_m (0.2) allowed"),
        ("PUR_TURN_TO", 61.0, "61 found, at most turn_on_spot_deg (60) allowed"),
        ("PUR_TURN_FROM", 7.0, "8 found, at most turn_on_spot_deg (7) allowed"),
        ("SYSID_THISMAV", 255, "255 found, which is the robot's own system_id"),
        ("SYSID_MYGCS", 1, "1 found, which is the robot's own system_id"),
        ("FS_GCS_HOLD", 2, "2 found, 0 or 1 allowed"),
        ("SAF_SETPOINT_MS", 99, "99 is under two steps of navigation (100 ms at 20 Hz)"),
        ("GRD_DECEL", 2.6, "2.6 found, at most limits.a_max_m_s2 (2.5) allowed"),
    ],
)
def test_what_contradicts_another_value_is_refused(name, value, says):
    found, put = parameters()
    problem, text = refusal(put, name, value)
    assert problem is ParamError.VALUE_OUT_OF_RANGE
    assert says in text
    assert found.changes() == {}


@pytest.mark.parametrize("name", ["diff_drive", "ackermann"])
def test_a_robot_can_be_made_with_each_bound_that_is_taken(name):
    options = StackOptions("bounds", str(find_file(name)), ())
    config, taken = ROBOTS[name], 0
    for parameter in PARAMETERS:
        for bound in (parameter.low, parameter.high):
            found = ParameterSet(Configurations(config, config, contradictions), {})
            if (index := found.index_of(parameter.name)) is None:
                continue
            try:
                found.set(found.parameters[index], single(bound), REAL32)
            except ParameterRefused:
                continue
            changed, refused = with_values(config, found.changes(), contradictions)
            assert not refused
            make_core(changed, options)
            make_navigation(changed, options).navigator.retune(found.live())
            taken += 1
    assert taken > 100


@given(st.lists(st.tuples(st.sampled_from(PARAMETERS), st.floats(width=32)), max_size=12))
def test_whatever_is_set_the_robot_can_start_with_it_and_nothing_in_force_is_less_safe(asked):
    found, _ = parameters()
    for parameter, value in asked:
        if found.index_of(parameter.name) is None:
            continue
        kind = REAL32 if isinstance(found.value(parameter), float) else INT32
        try:
            found.set(parameter, value, kind)
        except ParameterRefused:
            continue
    config, refused = with_values(CONFIG, found.changes(), contradictions)
    assert not refused
    assert not list(contradictions(config))
    assert not list(contradictions(found.now))
    for parameter in found.parameters:
        now, then = value_at(found.now, parameter.key), value_at(CONFIG, parameter.key)
        assert parameter.change.nearest(now, then) == now


def test_values_that_are_allowed_only_together_are_taken_in_any_order():
    values = {"navigation.guard.deceleration_m_s2": 3.0, "limits.a_max_m_s2": 4.0}
    for order in (values, dict(reversed(values.items()))):
        config, refused = with_values(CONFIG, order, contradictions)
        assert not refused
        assert config.navigation.guard.deceleration_m_s2 == 3.0


def test_a_value_that_is_no_longer_allowed_is_named_and_left_out():
    slow = dataclasses.replace(CONFIG.limits, a_max_m_s2=0.85)
    config = dataclasses.replace(CONFIG, limits=slow)
    values = {
        "navigation.guard.deceleration_m_s2": 2.0,
        "control.left.kp": 0.7,
        "control.left.kk": 1.0,
        "control.right.kp": -1.0,
        "safety.arm_timeout_ms": 10.5,
    }
    config, refused = with_values(config, values, contradictions)
    assert config.control.left.kp == 0.7
    assert refused.keys() == values.keys() - {"control.left.kp"}
    assert "at most limits.a_max_m_s2" in refused["navigation.guard.deceleration_m_s2"]
    assert refused["control.left.kk"] == "control.left.kk: no such key"
    assert refused["control.right.kp"].startswith("control.right.kp: -1.0 found")
    assert "whole number" in refused["safety.arm_timeout_ms"]


def test_the_state_of_the_body_is_a_parameter_where_there_are_several(tmp_path):
    path = tmp_path / "forklift.toml"
    states = '[body]\noutline = [[0.2,0.2],[-0.2,0.2],[-0.2,-0.2],[0.2,-0.2]]\nstates = ["a", "b"]'
    path.write_text(f"{find_file('diff_drive').read_text()}\n{states}\nstate = 0\n")
    config = load_robot(path)
    found = ParameterSet(Configurations(config, config, contradictions), {})
    parameter = found.parameters[found.index_of("BODY_STATE")]
    assert found.set(parameter, 1.0, INT32) == "0 -> 1"
    assert found.live() == {"body.state": 1}
    with pytest.raises(ParameterRefused, match=r"2 found; allowed are 0 \(a\), 1 \(b\)"):
        found.set(parameter, 2.0, INT32)
    assert found.in_force(parameter) == 1
    assert parameters()[0].index_of("BODY_STATE") is None
