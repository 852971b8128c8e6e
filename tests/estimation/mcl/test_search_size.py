"""Random poses of a search follow the area, within bounds."""

import pytest

from robotctl.estimation.mcl.search_size import search_size, too_large


@pytest.mark.parametrize(
    ("area_m2", "size"),
    [
        (0.0, 20_000),
        (20.0, 20_000),
        (400.0, 20_000),
        (1280.0, 64_000),
        (22_000.0, 1_100_000),
        (1e6, 5_000_000),
    ],
)
def test_the_number_follows_the_area_within_bounds(area_m2, size):
    assert search_size(area_m2) == size


def test_what_is_too_large_is_said_with_what_would_do():
    assert too_large(100_000.0) is None
    assert "166000 m2" in too_large(166_000.0)
    assert "100000 m2 at most" in too_large(166_000.0)
