"""Rhythm of frames: one sender or two."""

from __future__ import annotations

from robotctl.drivers.can.probe import come_from_two
from tests.drivers.can.drives.scan_bench import MS


def test_one_sender_is_not_taken_for_two():
    steady = [100 * MS * beat for beat in range(9)]
    assert not come_from_two(steady)
    assert not come_from_two(steady[:5])
    assert come_from_two(sorted(steady + [stamp + 30 * MS for stamp in steady]))
    jittered = [stamp + (stamp // MS * 7919) % 3 * MS for stamp in steady]
    assert not come_from_two(jittered)
