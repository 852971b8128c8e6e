"""Which maps a robot can find itself in."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from robotctl.errors import ConfigError
from robotctl.maps.localisation_map import load_localisation_map
from robotctl.maps.map_file import save_map
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap


def saved(folder, cells):
    save_map(folder / "room", GridMap(np.array(cells, np.int8), 0.05))
    return "room.yaml"


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ([[OCCUPIED]], "has 1 x 1 cells, and a robot finds itself in two by two at least"),
        ([[OCCUPIED, FREE, FREE]], "has 3 x 1 cells"),
        ([[FREE], [OCCUPIED]], "has 1 x 2 cells"),
        ([[OCCUPIED, UNKNOWN], [OCCUPIED, UNKNOWN]], "no free cell: there is no place for a robot"),
        ([[FREE, UNKNOWN], [FREE, 49]], "no obstacle, a cell of 50 % or more"),
    ],
)
def test_a_map_that_tells_no_place_from_another_is_refused_in_words(tmp_path, cells, said):
    name = saved(tmp_path, cells)
    with pytest.raises(ConfigError, match=f"room.yaml: .*{said}"):
        load_localisation_map(name, tmp_path)


def test_two_by_two_cells_are_a_map(tmp_path):
    name = saved(tmp_path, [[OCCUPIED, FREE], [FREE, UNKNOWN]])
    assert load_localisation_map(name, tmp_path).walls is None


@pytest.mark.parametrize("name", ["drive.log", "drive.log.gz", "drive.yaml"])
def test_a_log_where_a_map_is_needed_is_called_a_log(tmp_path, name):
    text = b"# CARMEN Logfile\nODOM 1 2 3 0 0 0 1.5 host 1.5\n"
    (tmp_path / name).write_bytes(gzip.compress(text) if name.endswith(".gz") else text)
    with pytest.raises(ConfigError, match=f"{name}: a recorded log where a map is needed"):
        load_localisation_map(str(tmp_path / name), tmp_path)
