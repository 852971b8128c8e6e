"""After each fault the wheels lose their power in time, whenever it strikes; in lockstep."""

import pytest
from reactions import measure

from hil_tests.fault_rows import ROWS
from robotctl.app.config import find_file


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_the_wheels_lose_their_power_in_time(row):
    assert measure(find_file("diff_drive"), row, seed=101) <= row.limit_ms
