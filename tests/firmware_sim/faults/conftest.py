"""Fixtures of a robot that stands, and of one that drives."""

from __future__ import annotations

import numpy as np
import pytest

from tests.firmware_sim.faults.fault_bench import Bench


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def driving(bench):
    bench.drive(1.0)
    assert np.all(np.diff(bench.counts()[-20:], axis=0).mean(axis=0) > 5)
    return bench
