"""What is new in a stream of control states that repeat each range."""

from __future__ import annotations

import math

import pytest

from robotctl.model.sensors.new_sonar_readings import NewSonarReadings

MS = 1_000_000


def test_sonar_readings_are_told_once_those_of_one_time_together() -> None:
    news = NewSonarReadings(0.0)
    first, second = news.take(100 * MS, (50, 50, 90), (1.0, 2.0, math.inf))
    assert first.stamp_ns == 50
    assert first.ranges_m == pytest.approx((1.0, 2.0, math.nan), nan_ok=True)
    assert first.first == 0
    assert second.ranges_m == pytest.approx((math.nan, math.nan, math.inf), nan_ok=True)
    assert second.first == 2
    assert news.take(100 * MS, (50, 50, 90), (1.0, 2.0, math.inf)) == []
    (third,) = news.take(100 * MS, (95, 95, 90), (1.5, 2.5, 3.0))
    assert third.stamp_ns == 95
    assert third.ranges_m == pytest.approx((1.5, 2.5, math.nan), nan_ok=True)


def test_ranges_count_when_the_sound_was_sent() -> None:
    # 3.43 m there and back take sound 20 ms; without an echo the ring listens for all of its 4 m.
    stamps = (80 * MS, 80 * MS, 90 * MS)
    first, second = NewSonarReadings(4.0).take(100 * MS, stamps, (1.0, 3.43, math.inf))
    assert first.stamp_ns == pytest.approx(60 * MS, abs=2)
    assert second.stamp_ns == pytest.approx((90 - 8000 / 343) * MS, abs=2)


def test_readings_from_too_long_ago_and_without_a_word_are_no_news() -> None:
    assert NewSonarReadings(4.0).take(1000 * MS, (400 * MS, 900 * MS), (1.0, math.nan)) == []
