"""Messages read back from a log are those that were published, as far as JSON keeps them."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.logs.mcap.entries import LogEntries
from robotctl.logs.mcap.foxglove import log_line, severity_of
from robotctl.logs.mcap.restored import RESTORED
from robotctl.logs.mcap.scene import Scene, sonar_mounts
from robotctl.messages.control import ControlState, ImuFeedback, Notice
from robotctl.messages.estimation import ClosedLoop, LidarScan, LocalisationState
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.sensors.sonar import SonarMount
from tests.logs.mcap.test_log import FULL
from tests.logs.mcap.test_schema import _float32
from tests.mavlink.conftest import CONTROL, NAVIGATION

EPOCH_NS = 1_700_000_000_000_000_000
NUMBERS = st.floats(-1e6, 1e6)
IMU = ImuFeedback(5, 4, (0.1, 0.2, 0.3), (0.0, 0.1, 9.8), (0.0, 0.0, 1.0))


def read_back(message: msgspec.Struct) -> msgspec.Struct:
    """Return what a log makes of a message."""
    entries = LogEntries(EPOCH_NS, "rover", Scene()).of(message)  # type: ignore[arg-type]
    (found,) = (
        RESTORED[topic](wall_ns - EPOCH_NS, msgspec.json.decode(msgspec.json.encode(make())))
        for topic, wall_ns, make in entries
        if topic in RESTORED
    )
    return found


@given(st.tuples(*[NUMBERS] * 5), st.lists(NUMBERS), st.booleans())
def test_states_come_back_to_the_bit(
    numbers: tuple[float, ...], currents: list[float], has_imu: bool
) -> None:
    x_m, y_m, theta_rad, v_m_s, odometer_m = numbers
    state = msgspec.structs.replace(
        FULL, sonar_m=(math.inf, 0.5), sonar_stamp_ns=(1, 2), x_m=x_m, y_m=y_m, v_m_s=v_m_s,
        theta_rad=theta_rad, odometer_m=odometer_m, current_a=tuple(currents),
        imu=IMU if has_imu else None,
    )  # fmt: skip
    assert read_back(state) == state


@pytest.mark.parametrize(
    "message",
    [
        CONTROL,
        NAVIGATION,
        msgspec.structs.replace(NAVIGATION, goal=(1.0, 2.0), home=(1.0, 2.0, 3.0), waits=True),
        LocalisationState(
            5, "slam", LocalisationStatus.LOCALISED, 1.0, 2.0, 0.5, (0.1,) * 6, nis=1.0,
            loops=(ClosedLoop(4, 1, 0.1, 0.2, 0.3),),
        ),
        LidarScan(6, 0.1, 0.0, -1.0, 0.5, 8.0, _float32(1.0, math.inf, 2.5)),
    ],
)  # fmt: skip
def test_messages_come_back_as_they_were(message: msgspec.Struct) -> None:
    back = read_back(message)
    assert type(back) is type(message)
    assert back == message


def test_what_json_cannot_say_is_nan_or_empty() -> None:
    imu = msgspec.structs.replace(IMU, up=(math.nan, 0.0, 1.0))
    state = msgspec.structs.replace(CONTROL, v_m_s=math.inf, duty=(math.nan, 1.0), imu=imu)
    back = read_back(state)
    assert isinstance(back, ControlState)
    assert math.isnan(back.v_m_s)
    assert back.duty == ()
    assert back.imu is not None
    assert all(map(math.isnan, back.imu.up))
    assert back.imu.force_m_s2 == IMU.force_m_s2


@pytest.mark.parametrize("severity", range(8))
def test_the_severity_of_a_notice_keeps_its_level(severity: int) -> None:
    back = read_back(Notice(7, severity, "look"))
    assert isinstance(back, Notice)
    assert (back.stamp_ns, back.text) == (7, "look")
    assert log_line(0, back, "").level == log_line(0, Notice(7, severity, ""), "").level
    assert severity_of(log_line(0, Notice(0, severity, ""), "").level) == back.severity


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-179.0, 179.0))
def test_sonars_sit_where_their_frames_say(x_m: float, y_m: float, heading_deg: float) -> None:
    mounts = (SonarMount("front_left", x_m, y_m, heading_deg), SonarMount("rear", 0.0, 0.0, 180.0))
    frames = Scene(mounts).sensor_frames(0)
    assert frames is not None
    for mount, back in zip(mounts, sonar_mounts(frames.transforms), strict=True):
        assert (back.name, back.x_m, back.y_m) == (mount.name, mount.x_m, mount.y_m)
        turn = math.radians(back.heading_deg - mount.heading_deg)
        assert math.sin(turn) == pytest.approx(0.0, abs=1e-9)
        assert math.cos(turn) > 0.0
