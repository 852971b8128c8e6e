from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.errors import ConfigError
from robotctl.maps.map_file import load_map, save_map
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap


def write_map(folder, pixels, suffix=".png", **keys):
    """Write an image and its yaml; return the yaml's path."""
    assert cv2.imwrite(str(folder / f"room{suffix}"), pixels)
    values = {"image": f"room{suffix}", "resolution": 0.1, "origin": [1.0, 2.0, 0.5], **keys}
    lines = [f"{key}: {value}" for key, value in values.items() if value is not None]
    path = folder / "room.yaml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def loop_cell(channels, has_alpha, mode, negate, occupied_thresh, free_thresh):
    """Return one cell by the page of nav2's map server, read line by line."""
    colours = channels[:-1] if has_alpha else channels
    if mode == "raw":
        value = round(sum(colours) / len(colours))
        return value if value <= 100 else -1
    averaged = channels if mode == "trinary" else colours
    shade = sum(averaged) / len(averaged) / 255.0
    p = shade if negate else 1.0 - shade
    if mode == "scale" and has_alpha and channels[-1] < 255:
        return -1
    if p > occupied_thresh:
        return 100
    if p < free_thresh:
        return 0
    if mode == "trinary":
        return -1
    return round(100.0 * (p - free_thresh) / (occupied_thresh - free_thresh))


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_each_pixel_becomes_the_cell_that_the_map_server_makes_of_it(
    tmp_path, mode, negate, channels
):
    rng = np.random.default_rng(channels)
    pixels = rng.integers(0, 256, (9, 14, channels), dtype=np.uint8)
    pixels[::2, ::3] //= 3
    if channels == 4:
        pixels[:, ::2, 3] = 255
    path = write_map(
        tmp_path, pixels, mode=mode, negate=negate, occupied_thresh=0.7, free_thresh=0.3
    )
    grid = load_map(path)
    expected = [
        [loop_cell(list(map(int, cell)), channels == 4, mode, negate, 0.7, 0.3) for cell in row]
        for row in pixels[::-1]
    ]
    np.testing.assert_array_equal(grid.cells, expected)
    assert len(np.unique(grid.cells)) >= 3


def test_the_first_row_of_the_image_is_the_upper_edge_and_the_origin_turns_the_map(tmp_path):
    pixels = np.full((3, 5), 254, np.uint8)
    pixels[0, 4] = 0  # upper right
    grid = load_map(write_map(tmp_path, pixels))
    assert grid.cells.shape == (3, 5)
    assert np.argwhere(grid.cells == OCCUPIED).tolist() == [[2, 4]]
    assert (grid.resolution_m, grid.origin) == (0.1, SE2(1.0, 2.0, 0.5))
    right, up = 0.45, 0.25  # the pixel's middle from the lower left corner
    x = 1.0 + right * math.cos(0.5) - up * math.sin(0.5)
    y = 2.0 + right * math.sin(0.5) + up * math.cos(0.5)
    assert grid.cell_of(np.array([[x, y]])).tolist() == [[2, 4]]


def test_sixteen_bits_and_mode_names_in_capitals_are_read(tmp_path):
    pixels = np.array([[0, 30000, 65535]], np.uint16)
    assert load_map(write_map(tmp_path, pixels, mode="Trinary")).cells.tolist() == [[100, -1, 0]]


def test_without_thresholds_those_of_nav2_hold(tmp_path):
    pixels = np.array([[255 - 166, 255 - 165, 255 - 64, 255 - 63]], np.uint8)
    assert load_map(write_map(tmp_path, pixels)).cells.tolist() == [[100, -1, -1, 0]]


@pytest.mark.parametrize("percentages", [False, True])
def test_a_saved_map_is_read_back_as_it_was(tmp_path, percentages):
    rng = np.random.default_rng(5)
    values = range(-1, 101) if percentages else [FREE, OCCUPIED, UNKNOWN]
    cells = rng.choice(np.array(values, np.int8), (20, 31))
    grid = GridMap(cells, 0.03, SE2(-1.25, 1.0 / 3.0, -2.5))
    yaml_file, image_file = save_map(tmp_path / 'floor "2": o.k', grid)
    assert (yaml_file.suffix, image_file.suffix) == (".yaml", ".pgm")
    again = load_map(yaml_file)
    np.testing.assert_array_equal(again.cells, cells)
    assert (again.resolution_m, again.origin) == (grid.resolution_m, grid.origin)


def test_a_saved_map_has_the_colours_of_ros(tmp_path):
    grid = GridMap(np.array([[FREE, OCCUPIED], [UNKNOWN, FREE]], np.int8), 0.05)
    _, image_file = save_map(tmp_path / "room", grid)
    assert image_file.read_bytes() == b"P5\n2 2\n255\n" + bytes([205, 254, 254, 0])


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"resolution": 0}, "resolution: must be a number of metres above 0, found 0"),
        ({"resolution": "fine"}, "resolution: must be .*, found 'fine'"),
        ({"origin": [1, 2]}, r"origin: must be \[x, y, yaw\].*found \[1, 2\]"),
        ({"origin": "[1, 2, .nan]"}, r"origin: must be .*found \[1, 2, nan\]"),
        ({"mode": "binary"}, "mode: must be one of trinary, scale, raw, found 'binary'"),
        ({"negate": "[2]"}, "negate: must be 0, 1, true or false, found"),
        ({"free_thresh": 1.5}, r"free_thresh: must lie in \[0, 1\], found 1.5"),
        (
            {"free_thresh": 0.9},
            "free_thresh: must not be above occupied_thresh, found 0.9 and 0.65",
        ),
        ({"resolution": None}, "resolution: must be .*, missing"),
        ({"image": None, "picture": "a"}, "image: must be the path of an image, missing"),
        ({"ocupied_thresh": 0.5}, 'unknown key; did you mean "occupied_thresh"'),
        ({"image": "other.png"}, r"image: .*other.png does not exist"),
        ({"image": "room.yaml"}, r"room.yaml: no image"),
    ],
)
def test_what_is_wrong_is_named_with_file_key_found_and_allowed(tmp_path, keys, message):
    path = write_map(tmp_path, np.zeros((2, 2), np.uint8), **keys)
    with pytest.raises(ConfigError, match=message) as error:
        load_map(path)
    assert str(error.value).startswith(str(tmp_path))


def test_all_errors_of_a_file_come_at_once(tmp_path):
    path = write_map(tmp_path, np.zeros((2, 2), np.uint8), resolution=-1, mode="x", negate=7)
    with pytest.raises(ConfigError) as error:
        load_map(path)
    assert len(str(error.value).splitlines()) == 3


@pytest.mark.parametrize("text", ["", "just words", "a: [", "- 1"])
def test_what_is_no_map_is_refused(tmp_path, text):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"bad\.yaml: "):
        load_map(path)


def read_pgm(data):
    """Return the grey values of a binary pgm, by the format's definition."""
    words, at = [], 0
    while len(words) < 4:
        end = data.index(b"\n", at)
        words += data[at:end].split(b"#")[0].split()
        at = end + 1
    assert words[0] == b"P5"
    assert words[3] == b"255"
    columns, rows = int(words[1]), int(words[2])
    return np.frombuffer(data, np.uint8, rows * columns, at).reshape(rows, columns)


@pytest.mark.recordings("maps/tb3_sandbox.yaml", "maps/warehouse.yaml")
@pytest.mark.parametrize(("name", "free_thresh"), [("tb3_sandbox", 0.196), ("warehouse", 0.1)])
def test_maps_of_nav2_are_read_cell_for_cell(recordings, name, free_thresh):
    grid = load_map(recordings / "maps" / f"{name}.yaml")
    p = (255 - read_pgm((recordings / "maps" / f"{name}.pgm").read_bytes()).astype(float)) / 255.0
    assert np.count_nonzero(grid.occupied()) == np.count_nonzero(p > 0.65) > 0
    assert np.count_nonzero(grid.free()) == np.count_nonzero(p < free_thresh) > 0
    assert np.count_nonzero(grid.cells == UNKNOWN) > 0
    np.testing.assert_array_equal(grid.occupied()[::-1], p > 0.65)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-05", 1e-5),
        ("5e-2", 0.05),
        ("-1.2e1", -12.0),
        ("-.5", -0.5),
        ("+.5E+1", 5.0),
        ("-0", 0.0),
        ("3.", 3.0),
        ('"0.25"', 0.25),
        ("'-1e-3'", -0.001),
        ('" 2 "', 2.0),
        ("-10.000000", -10.0),
        ("0.1000000015", 0.1000000015),
        ("1e+30", 1e30),
    ],
)
def test_numbers_are_read_as_c_and_python_print_them(tmp_path, text, value):
    path = write_map(tmp_path, np.zeros((2, 2), np.uint8), origin=f"[{text}, 0, {text}]")
    assert load_map(path).origin == SE2(value, 0.0, value)


def test_every_number_may_be_quoted_or_have_an_exponent(tmp_path):
    keys = {
        "resolution": "5e-2",
        "negate": '"1"',
        "occupied_thresh": "6e-1",
        "free_thresh": '"0.4"',
        "mode": '"Trinary"',
    }
    grid = load_map(write_map(tmp_path, np.array([[160, 140, 90]], np.uint8), **keys))
    assert grid.resolution_m == 0.05
    assert grid.cells.tolist() == [[100, -1, 0]]


@pytest.mark.parametrize("text", ["1e", "1_0e3", "0x1p3", "e5", "--1", "1e400", "nan", "inf", '""'])
def test_what_is_no_finite_number_is_refused(tmp_path, text):
    path = write_map(tmp_path, np.zeros((2, 2), np.uint8), origin=f"[{text}, 0, 0]")
    with pytest.raises(ConfigError, match=r"origin: must be .*three finite numbers"):
        load_map(path)


@given(
    st.floats(-1e9, 1e9),
    st.floats(-1e-4, 1e-4),
    st.floats(1e-9, 1e3),
)
def test_whatever_is_saved_can_be_loaded(tmp_path_factory, x_m, theta_rad, resolution_m):
    grid = GridMap(np.array([[FREE, OCCUPIED]], np.int8), resolution_m, SE2(x_m, -x_m, theta_rad))
    yaml_file, _ = save_map(tmp_path_factory.mktemp("map") / "room", grid)
    again = load_map(yaml_file)
    assert (again.resolution_m, again.origin) == (grid.resolution_m, grid.origin)
