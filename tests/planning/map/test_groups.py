"""Who walks together is a group, and nobody else."""

import numpy as np
import pytest

from robotctl.planning.map.groups import with_groups

ONE = (2.0, 0.0, 0.8, 0.1, 0.22)
FAR = (0.0, -5.0)


@pytest.mark.parametrize(
    ("other", "is_group"),
    [
        ((2.0, 1.2, 0.7, 0.0, 0.22), True),
        ((1.2, 0.9, 0.8, 0.1, 0.25), True),  # behind each other, too
        ((2.0, 1.8, 0.8, 0.1, 0.22), False),  # too far apart
        ((2.0, 1.2, -0.8, 0.1, 0.22), False),  # walks the other way
    ],
)
def test_two_who_walk_alike_close_the_gap_between_them(other, is_group):
    moving = np.array([ONE, other])
    grouped = with_groups(moving, 1.5, FAR, 0.3)
    assert (grouped[:2] == moving).all()
    assert len(grouped) == 2 + is_group
    if is_group:
        x, y, vx, vy, radius = grouped[2]
        assert (x, y, vx, vy) == pytest.approx(tuple(moving[:, :4].mean(axis=0)))
        assert radius == pytest.approx(0.5 * np.hypot(*(moving[0] - moving[1])[:2]))


def test_a_robot_that_is_between_them_already_may_get_out():
    moving = np.array([ONE, (2.0, 1.2, 0.7, 0.0, 0.22)])
    assert len(with_groups(moving, 1.5, (2.0, 0.6), 0.3)) == 2


def test_without_the_setting_everybody_is_alone():
    moving = np.array([ONE, (2.0, 1.2, 0.7, 0.0, 0.22)])
    assert with_groups(moving, 0.0, FAR, 0.3) is moving
