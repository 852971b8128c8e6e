"""Messages of each kind, as a ground station gets them."""

from scipy.spatial.transform import Rotation

from robotctl.messages.control import (
    ImuFeedback,
)


def one_of_each(bench, **control):
    """Return the first message of each name after half a second."""
    bench.run(0.5, **control)
    first = {}
    for message, _ in bench.take():
        first.setdefault(message.get_type(), message)
    return first


NOSE_UP_DEG, LEFT_UP_DEG = 12.0, 5.0


def tilted(**changes):
    """What the IMU of a robot says that stands nose up and left side up, and turns left."""
    attitude = Rotation.from_euler("ZYX", [0.7, -NOSE_UP_DEG, LEFT_UP_DEG], degrees=True)
    up = attitude.inv().apply([0.0, 0.0, 1.0])
    values = {
        "stamp_ns": 5_000_000_000,
        "gyro_stamp_ns": 5_000_000_000,
        "rate_rad_s": (0.1, 0.2, 0.3),
        "force_m_s2": tuple(9.80665 * up),
        "up": tuple(up),
        "bias_rad_s": (0.01, 0.02, 0.03),
    }
    return ImuFeedback(**values | changes)
