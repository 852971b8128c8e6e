"""Parameters that other processes of the robot ask for, by the rules of ground stations."""

import math

import msgspec
import pytest
import zmq
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as m

from robotctl.config.robot_file import contradictions, find_file, load_robot
from robotctl.mavlink.parameters.parameter_set import Configurations, ParameterSet
from robotctl.mavlink.parameters.published import table_of
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import SafetyState
from robotctl.messages.mavlink_port import Peer
from robotctl.messages.tuning import (
    ParameterAnswer,
    ParameterRequest,
    ParameterValues,
    ResetParameters,
    SetParameter,
    Tuning,
)
from robotctl.runtime.ipc.topics import RequestReceiver
from tests.mavlink.conftest import Bench

CONFIG = load_robot(find_file("diff_drive"))
KP = "control.left.kp"


class Store:
    """Keeps the values that it was last given."""

    def __init__(self):
        self.values = {}

    def save(self, values):
        self.values = dict(values)
        return True


class Asking(Bench):
    """Another process of the robot beside two ground stations."""

    def __init__(self):
        super().__init__(2)
        self.store = Store()
        self.parameters = ParameterSet(Configurations(CONFIG, CONFIG, contradictions), {})
        self.telemetry = Telemetry(
            CONFIG.mavlink,
            self.robot,
            self.links,
            parameters=self.parameters,
            parameter_store=self.store,
        )
        self.values: ParameterValues | None = None
        """The newest that were published."""
        self.names = [each.name for each in table_of(self.parameters, 0).parameters]

    def ask(self, *requests, **control):
        """Let requests arrive; return the refusals."""
        self.step(*requests, self.control(**control))
        self.news = self.telemetry.take_news()
        self.values = next(
            (each for each in reversed(self.news) if isinstance(each, ParameterValues)), self.values
        )
        return [each.refusal for each in self.news if isinstance(each, ParameterAnswer)]

    def put(self, name, value, age_s=0.0, **control):
        stamp_ns = self.now_ns + 20_000_000 - round(age_s * 1e9)
        return self.ask(SetParameter(stamp_ns, 7, name, value), **control)

    def wanted(self):
        """Return the published values, by name."""
        return dict(zip(self.names, self.values.wanted, strict=True))


@pytest.fixture
def asking():
    return Asking()


def test_a_value_is_taken_kept_published_and_told_to_ground_stations(asking):
    asking.take()
    assert asking.put("CTL_L_KP", 0.7) == [""]
    asking.step(asking.control())
    told = asking.take("PARAM_VALUE")
    assert {to for _, to in told} == {Peer(0, 0), Peer(1, 0)}
    assert {(each.param_id, round(each.param_value, 6)) for each, _ in told} == {("CTL_L_KP", 0.7)}
    assert asking.store.values == {KP: 0.7}
    requests = asking.run(0.6)
    assert {tuple(each.values.items()) for each in requests if isinstance(each, Tuning)} == {
        ((KP, 0.7),)
    }


def test_a_value_of_a_ground_station_is_published_at_once(asking):
    asking.receive(m.MAVLink_param_set_message(1, 1, b"CTL_L_KP", 0.8, m.MAV_PARAM_TYPE_REAL32))
    asking.ask()
    assert asking.wanted()["CTL_L_KP"] == 0.8


def test_values_are_published_each_second_for_who_comes_late(asking):
    seen = []
    for _ in range(150):  # 3 s
        asking.ask()
        seen += [each for each in asking.news if isinstance(each, ParameterValues)]
    assert 3 <= len(seen) <= 4


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("NOTHING", 1.0, "no such parameter"),
        ("CTL_L_KP", -1.0, "0 to 100 allowed"),
        ("CTL_L_KP", math.nan, "is no number"),
        ("CTL_L_KP", math.inf, "is no number"),
        ("CTL_L_KP", 1e300, "0 to 100 allowed"),
        ("SAF_ARM_MS", 1000.5, "a whole number allowed"),
        ("GEO_COUNTS", 100.0, "robot's file only"),
        ("GRD_DECEL", 20.0, "at most limits.a_max_m_s2"),
    ],
)
def test_what_is_not_allowed_is_refused_in_the_words_for_ground_stations(asking, name, value, said):
    (refusal,) = asking.put(name, value)
    assert said in refusal
    asking.run(0.6)
    assert asking.store.values == {}


def test_a_request_that_waited_is_refused(asking):
    assert "too old" in asking.put("CTL_L_KP", 0.7, age_s=1.1)[0]
    assert "of the future" in asking.put("CTL_L_KP", 0.7, age_s=-0.5)[0]
    assert asking.put("CTL_L_KP", 0.7, age_s=0.9) == [""]


def test_no_value_and_a_reset_bring_back_those_of_the_file(asking):
    asking.put("CTL_L_KP", 0.7)
    asking.put("CTL_L_KI", 5.0)
    asking.run(0.6)
    asking.put("CTL_L_KP", None)
    assert (asking.wanted()["CTL_L_KP"], asking.wanted()["CTL_L_KI"]) == (0.65, 5.0)
    reset = ResetParameters(asking.now_ns, 8)
    assert asking.ask(reset, state=SafetyState.ARMED) == ["not while armed"]
    assert asking.ask(ResetParameters(asking.now_ns, 9)) == [""]
    assert asking.wanted()["CTL_L_KI"] == 4.3
    assert asking.store.values == {}


def test_what_waits_for_a_restart_is_published_beside_what_is_in_force(asking):
    asking.put("LIM_A_MAX", 2.6)
    place = asking.names.index("LIM_A_MAX")
    assert (asking.values.wanted[place], asking.values.in_force[place]) == (2.6, 2.5)


PLAIN = st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.floats() | st.text()
GARBAGE = st.binary(max_size=64) | st.builds(
    msgspec.msgpack.encode,
    st.fixed_dictionaries(
        {},
        optional={
            "type": st.sampled_from(["SetParameter", "ResetParameters", "Tuning", ""]),
            "stamp_ns": PLAIN,
            "request_id": PLAIN,
            "name": PLAIN | st.sampled_from(["CTL_L_KP", "LIM_V_MAX", "FS_GCS_HOLD", "GEO_COUNTS"]),
            "value": PLAIN | st.lists(PLAIN, max_size=3),
        },
    ),
)


@settings(max_examples=400, deadline=None)
@given(data=st.lists(GARBAGE, max_size=5))
def test_garbage_at_the_socket_sets_nothing_and_ends_nothing(data):
    """What is no request is dropped, and one of another time refused."""
    asking = shared()
    with zmq.Context() as context:
        address = "inproc://telemetry.requests"
        receiver = RequestReceiver(context, address, ParameterRequest)
        with context.socket(zmq.PUSH) as sender:
            sender.connect(address)
            for each in data:
                sender.send(each)
            requests = receiver.receive()
            receiver.close()
    refusals = asking.ask(*requests)
    assert len(refusals) == len(requests)
    assert all(refusals)
    assert asking.parameters.changes() == {}


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(["CTL_L_KP", "LIM_V_MAX", "FS_GCS_HOLD", "GEO_COUNTS", "GRD_DECEL", "x"]),
    st.floats() | st.integers(-(2**63), 2**63).map(float),
)
def test_only_what_is_allowed_is_ever_taken(name, value):
    asking = shared()
    (refusal,) = asking.put(name, value)
    known = {each.name: each for each in asking.parameters.parameters}
    if not refusal:
        parameter = known[name]
        assert parameter.low <= value <= parameter.high
        assert float(asking.parameters.value(parameter)) == pytest.approx(value)
    assert asking.parameters.reset() is not None


_SHARED = []


def shared():
    """Return one bench for all examples: to make it takes a while."""
    if not _SHARED:
        _SHARED.append(Asking())
    return _SHARED[0]
