"""Distances of the wheels."""

from tests.mavlink.services.telemetry.bench import one_of_each


def test_wheel_distances_are_those_of_the_driven_wheels(bench):
    message = one_of_each(bench)["WHEEL_DISTANCE"]
    assert message.count == 2
    assert message.distance[:3] == [3.5, 4.5, 0.0]
