"""Maps of the MovingAI benchmarks: the top row first, and what is none."""

import gzip

import numpy as np
import pytest

from robotctl.errors import ConfigError
from robotctl.maps.moving_ai import load_moving_ai

GOOD = "type octile\nheight 3\nwidth 4\nmap\n..@.\nTTTT\nGSOW\n"


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("packed", [False, True])
def test_the_top_row_comes_first_and_dots_grass_and_swamp_are_passable(tmp_path, newline, packed):
    data = GOOD.replace("\n", newline).encode()
    path = tmp_path / ("m.map.gz" if packed else "m.map")
    path.write_bytes(gzip.compress(data) if packed else data)
    grid = load_moving_ai(path)
    assert grid.resolution_m == 1.0
    assert np.flipud(grid.cells).tolist() == [[0, 0, 100, 0], [100] * 4, [0, 0, 100, 100]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "begins with ''; a MovingAI map begins with the lines `type octile`"),
        (GOOD.replace("height 3", "height three"), "a MovingAI map begins with"),
        (GOOD.replace("height 3", "height 4"), "cut short: 3 of 4 rows"),
        (GOOD.replace("TTTT", "TTT"), ":6: 3 cells, the map is 4 wide"),
        (GOOD.replace("TTTT", "TxTT"), ":6: 'x' is no cell; .GS@OTW are"),
        (GOOD.replace("width 4", "width 0"), "0 x 3 cells; 1 to"),
    ],
)
def test_what_is_no_map_is_told_with_its_line(tmp_path, text, said):
    path = tmp_path / "m.map"
    path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        load_moving_ai(path)
    assert str(refused.value).startswith(str(path))
    assert said in str(refused.value)


def test_a_damaged_archive_is_told(tmp_path):
    path = tmp_path / "m.map.gz"
    path.write_bytes(gzip.compress(GOOD.encode())[:-9])
    with pytest.raises(ConfigError, match="cannot be read"):
        load_moving_ai(path)
