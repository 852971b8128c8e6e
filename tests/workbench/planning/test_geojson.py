"""Zones from GeoJSON: shapes against shapely, places against the ellipsoid, files that are none."""

import itertools
import json
import math
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import LineString, Point, Polygon
from shapely.ops import unary_union

from robotctl.cli.config import zones
from robotctl.errors import ConfigError
from robotctl.mavlink.globe import Origin
from robotctl.planning.behave.mission.mission_file import parse_mission
from robotctl.workbench.planning.geojson import as_toml, in_metres, load_zones, on_globe

SQUARE = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0], [0.0, 0.0]]
PLACES = st.tuples(st.integers(-50, 50), st.integers(-50, 50)).map(list)


def feature(kind, coordinates, **properties):
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def written(folder, *features, name="site.geojson"):
    file = folder / name
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return file


def test_a_polygon_is_a_zone_with_its_name_and_limit(tmp_path):
    file = written(tmp_path, feature("Polygon", [SQUARE], name="pool", speed_m_s=0.3))
    (zone,) = load_zones(file, in_metres)
    assert (zone.name, zone.speed_m_s) == ("pool", 0.3)
    assert Polygon(zone.corners).equals(Polygon(SQUARE))
    assert len(zone.corners) == 4


@given(line=st.lists(PLACES, min_size=2, max_size=8), width_m=st.floats(0.05, 3.0))
def test_a_line_is_covered_to_half_its_width_and_nothing_beyond(tmp_path_factory, line, width_m):
    file = written(tmp_path_factory.mktemp("line"), feature("LineString", line, width_m=width_m))
    strips = unary_union([Polygon(zone.corners) for zone in load_zones(file, in_metres)])
    pieces = [LineString(each) for each in itertools.pairwise(line) if each[0] != each[1]]
    if not pieces:
        assert strips.is_empty
        return
    rim_m = 2e-4  # corners are rounded to a tenth of a millimetre
    whole = unary_union([each.buffer(0.5 * width_m, cap_style="square") for each in pieces])
    assert whole.buffer(rim_m).contains(strips)
    assert strips.buffer(rim_m).contains(whole)
    assert all(strips.buffer(rim_m).contains(Point(each)) for each in line if pieces)


def test_parts_of_a_feature_are_numbered(tmp_path):
    far = [[x + 10.0, y] for x, y in SQUARE]
    file = written(
        tmp_path,
        feature("MultiPolygon", [[SQUARE], [far]], name="beds"),
        feature("MultiLineString", [[[0, 9], [5, 9]], [[0, 8], [5, 8], [5, 9]]]),
    )
    names = [zone.name for zone in load_zones(file, in_metres)]
    assert names == ["beds 1", "beds 2", "zone 2 1", "zone 2 2", "zone 2 3"]


@pytest.mark.parametrize("latitude_deg", [-60.0, 0.0, 48.13])
def test_degrees_are_longitude_first_and_metres_those_of_the_ellipsoid(tmp_path, latitude_deg):
    """By the lengths of a degree in series of the latitude (WGS 84, to a millimetre)."""
    phi = math.radians(latitude_deg)
    north_m = 111132.954 - 559.822 * math.cos(2 * phi) + 1.175 * math.cos(4 * phi)
    east_m = 111412.84 * math.cos(phi) - 93.5 * math.cos(3 * phi) + 0.118 * math.cos(5 * phi)
    d = 1e-4
    ring = [[11.0 + x * d, latitude_deg + y * d] for x, y in ((0, 0), (1, 0), (1, 1), (0, 0))]
    file = written(tmp_path, feature("Polygon", [ring]))
    (zone,) = load_zones(file, on_globe(Origin(latitude_deg, 11.0)))
    expected = [(0.0, 0.0), (east_m * d, 0.0), (east_m * d, north_m * d)]
    for corner, place in zip(zone.corners, expected, strict=True):
        assert corner == pytest.approx(place, abs=2e-3)


@pytest.mark.parametrize(
    ("found", "told"),
    [
        (feature("Point", [1, 2]), r"features\[0\]: geometry: 'Point' found.*Polygon"),
        ({"type": "Feature", "geometry": None}, r"features\[0\]: geometry: None found"),
        ({"type": "Feature", "geometry": {"type": "Polygon"}}, r"features\[0\]: geometry"),
        (feature("Polygon", [SQUARE, SQUARE]), r"features\[0\]: a polygon with a hole"),
        (feature("Polygon", [[[0, 0], [1, 0], [0, 0]]]), r"features\[0\]: corners.*2 found, 3 to"),
        (feature("Polygon", [[[0, 0], ["a", 0], [1, 1]]]), r"coordinates: \['a', 0\] found"),
        (feature("Polygon", [[1, 2, 3]]), r"coordinates: 1 found, two or three numbers"),
        (feature("Polygon", None), r"features\[0\]"),
        (feature("LineString", [[0, 0], [1, 0]], width_m=0), r"width_m: 0 found, above 0 to 100"),
        (feature("Polygon", [SQUARE], speed_m_s="slow"), r"speed_m_s: 'slow' found, a number"),
        (feature("Polygon", [SQUARE], speed_m_s=-1), r"speed_m_s.*-1.0 found, 0 to 100"),
    ],
)
def test_what_is_no_zone_is_refused_by_feature(tmp_path, found, told):
    with pytest.raises(ConfigError, match=rf"site\.geojson: .*{told}"):
        load_zones(written(tmp_path, found), in_metres)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{", "no GeoJSON"),
        ('"a"', "type None found"),
        ('{"type": "Topology"}', "type 'Topology' found"),
        ('{"type": "FeatureCollection", "features": []}', "features: none found"),
    ],
)
def test_what_is_no_geojson_is_refused(tmp_path, text, told):
    file = tmp_path / "site.geojson"
    file.write_text(text)
    with pytest.raises(ConfigError, match=rf"site\.geojson: .*{told}"):
        load_zones(file, in_metres)


def test_what_is_printed_is_a_missions_zone(tmp_path, capsys):
    file = written(tmp_path, feature("Polygon", [SQUARE], name='the "pool"', speed_m_s=0.25))
    zones(file, metres=True, mission=True)
    printed = capsys.readouterr().out
    text = (
        'name = "m"\nstart = { x_m = 9.0, y_m = 9.0 }\n[[item]]\nkind = "wait"\nduration_s = 1.0\n'
    )
    mission = parse_mission(text + printed, "m.toml")
    assert mission.zone == tuple(load_zones(file, in_metres))


def test_the_robots_file_has_them_below_its_pilot(tmp_path):
    found = load_zones(written(tmp_path, feature("Polygon", [SQUARE])), in_metres)
    table = tomllib.loads(as_toml(found, "navigation.pilot.zone"))
    assert table["navigation"]["pilot"]["zone"][0]["name"] == "zone 1"


@pytest.mark.parametrize("choice", [{}, {"origin": "48,11", "metres": True}])
def test_it_must_be_said_what_the_file_measures(tmp_path, choice):
    file = written(tmp_path, feature("Polygon", [SQUARE]))
    with pytest.raises(ConfigError, match="one of --origin LAT,LON and --metres"):
        zones(file, **choice)


@pytest.mark.parametrize("origin", ["48", "a,b", "95,11"])
def test_an_origin_that_is_none_is_refused(tmp_path, origin):
    with pytest.raises(ConfigError, match=f"--origin {origin}: "):
        zones(written(tmp_path, feature("Polygon", [SQUARE])), origin=origin)
