"""Places on the globe and in `world`, against distances on the ellipsoid by another formula."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.mavlink.globe import Origin

LATITUDE = st.floats(-85.0, 85.0)
LONGITUDE = st.floats(-180.0, 180.0)
NEAR = st.floats(-500.0, 500.0)


def cartesian(latitude_deg, longitude_deg):
    """Return the place on WGS 84 about the Earth's centre [m], by its half axes."""
    a, b = 6_378_137.0, 6_356_752.314245
    phi, lam = math.radians(latitude_deg), math.radians(longitude_deg)
    n = a * a / math.hypot(a * math.cos(phi), b * math.sin(phi))
    return (
        n * math.cos(phi) * math.cos(lam),
        n * math.cos(phi) * math.sin(lam),
        b * b / (a * a) * n * math.sin(phi),
    )


@given(LATITUDE, LONGITUDE, NEAR, NEAR)
def test_metres_in_world_are_metres_on_the_ground(latitude, longitude, x_m, y_m):
    origin = Origin(latitude, longitude)
    away_m = math.dist(cartesian(latitude, longitude), cartesian(*origin.from_world(x_m, y_m)))
    assert away_m == pytest.approx(math.hypot(x_m, y_m), abs=1e-3 + 1e-3 * math.hypot(x_m, y_m))


@given(LATITUDE, LONGITUDE, NEAR, NEAR)
def test_there_and_back_is_the_same_place_also_across_the_date_line(latitude, longitude, x, y):
    origin = Origin(latitude, longitude)
    assert origin.to_world(*origin.from_world(x, y)) == pytest.approx((x, y), abs=1e-6)


def test_north_is_y_and_east_is_x():
    origin = Origin(48.0, 11.0)
    x_m, y_m = origin.to_world(48.001, 11.0)
    assert (x_m, y_m) == pytest.approx((0.0, 111.2), abs=0.1)
    x_m, y_m = origin.to_world(48.0, 11.001)
    assert (x_m, y_m) == pytest.approx((74.6, 0.0), abs=0.1)


@pytest.mark.parametrize(
    ("place", "named"),
    [((89.5, 0.0), "latitude"), ((0.0, 180.5), "longitude"), ((math.nan, 0.0), "latitude")],
)
def test_no_origin_at_a_pole_or_off_the_globe(place, named):
    with pytest.raises(ValueError, match=named):
        Origin(*place)
