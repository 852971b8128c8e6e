"""Random bodies of simple polygons, and what shapely makes of them."""

import math

import shapely
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint


@st.composite
def polygons(draw, most=8, around=(0.0, 0.0)):
    """Draw corners of a simple polygon that goes round a place to the left."""
    count = draw(st.integers(3, most))
    shares = draw(st.lists(st.floats(0.2, 1.0), min_size=count, max_size=count))
    angles = [math.tau * sum(shares[: k + 1]) / sum(shares) for k in range(count)]
    lengths = draw(st.lists(st.floats(0.08, 0.6), min_size=count, max_size=count))
    return tuple(
        (round(around[0] + r * math.cos(a), 3), round(around[1] + r * math.sin(a), 3))
        for a, r in zip(angles, lengths, strict=True)
    )


@st.composite
def bodies(draw, most_parts=2):
    """Draw a body of a polygon around `base`, and perhaps parts beside or over it."""
    corners = draw(polygons().filter(_is_outline))
    places = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
    parts = tuple(
        draw(polygons(5, draw(places)).filter(_is_simple))
        for _ in range(draw(st.integers(0, most_parts)))
    )
    return Footprint(corners, parts)


def _is_simple(corners) -> bool:
    shape = shapely.Polygon(corners)
    return len(set(corners)) == len(corners) and shape.is_valid and shape.exterior.is_ccw


def _is_outline(corners) -> bool:
    base = shapely.Point(0.0, 0.0)
    shape = shapely.Polygon(corners)
    return _is_simple(corners) and shape.contains(base) and shape.exterior.distance(base) > 0.01


def shape_of(footprint: Footprint) -> shapely.Geometry:
    """Return the floor that a body covers."""
    return shapely.union_all([shapely.Polygon(each) for each in footprint.outlines])
