"""Driving straight to a point beside a robot that steers."""

from dataclasses import replace

from robotctl.messages.requests import (
    PositionRequest,
)
from tests.planning.bench import GUIDED


def test_a_point_beside_is_given_up_where_no_sonar_looks_back(steered, make_run):
    ahead_only = tuple(mount for mount in steered.mounts if "rear" not in mount.name)
    run = make_run(replace(steered, mounts=ahead_only), flat=False)
    run.step(GUIDED)
    for _ in range(40):
        out = run.step(PositionRequest(0.1, 0.25)) if run.now_ns < 1e8 else run.step()
        assert out.v_m_s == 0.0
    assert out.state.message == "0.3 m to go, too close beside: backing up needs a rear sonar"


def test_a_point_beside_is_reached_by_backing_up_where_a_sonar_looks_back(steered, make_run):
    run = make_run(steered, flat=False)
    run.step(GUIDED)
    out = run.step(PositionRequest(0.1, 0.25))
    assert out.v_m_s < 0.0
    assert "backing up" in out.state.message
    run.until(lambda out: out.state.message == "arrived", 30.0)
