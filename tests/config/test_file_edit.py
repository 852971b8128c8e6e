"""Changes of a robot's file, read by the standard library's own reader."""

import tomllib

import pytest

from robotctl.config.file_edit import Change, edit
from robotctl.errors import ConfigError

TEXT = """# A robot.
[drive]
counts = 2400    # at the wheel

[[motor]]
name = "one"     # the left one
axes = [{ actuator = "left" }, { actuator = "right", reversed = true }]

[[motor]]
name = "two"

[[motor.axes]]   # in tables of their own
actuator = "third"
"""


def changed(*changes):
    after, undo = edit(TEXT, changes)
    back, _ = edit(after, undo)
    assert tomllib.loads(back) == tomllib.loads(TEXT)
    for line in after.splitlines():
        assert line == line.rstrip()
    return after, tomllib.loads(after)


def test_a_value_is_replaced_in_its_place_and_keeps_its_comment():
    text, tables = changed(Change(("drive", "counts"), 1200))
    assert text == TEXT.replace("2400", "1200")
    assert tables["drive"]["counts"] == 1200


def test_a_key_of_a_table_in_a_line_is_changed_or_added():
    keys = ("motor", 0, "axes", 1, "reversed"), ("motor", 0, "axes", 0, "ratio")
    text, tables = changed(Change(keys[0], False), Change(keys[1], 15.0))
    assert tables["motor"][0]["axes"] == [
        {"actuator": "left", "ratio": 15.0},
        {"actuator": "right", "reversed": False},
    ]
    assert "# the left one" in text


def test_tables_in_lists_of_their_own_are_reached():
    _, tables = changed(Change(("motor", 1, "axes", 0, "reversed"), True))
    assert tables["motor"][1]["axes"] == [{"actuator": "third", "reversed": True}]


def test_a_new_table_has_the_value_and_its_comment():
    text, tables = changed(
        Change(("proof", "one"), "90 ms, then it brakes", "seen: 88 ms"),
        Change(("proof", "two"), "100 ms"),
    )
    assert tables["proof"] == {"one": "90 ms, then it brakes", "two": "100 ms"}
    assert 'one = "90 ms, then it brakes" # seen: 88 ms' in text
    assert text.startswith(TEXT.rstrip("\n"))


def test_tables_below_new_tables_are_made():
    _, tables = changed(Change(("a", "b", "c"), 1))
    assert tables["a"] == {"b": {"c": 1}}


def test_a_new_list_of_tables_is_written_with_a_line_for_each_axis():
    axes = [{"actuator": "left", "axis": 1}, {"actuator": "right", "axis": 2}]
    text, tables = changed(Change(("other",), [{"kind": "native", "axes": axes}]))
    assert tables["other"] == [{"kind": "native", "axes": axes}]
    assert '{actuator = "left", axis = 1}' in text.replace("{ ", "{").replace(" }", "}")


def test_a_key_is_taken_out():
    _, tables = changed(Change(("drive", "counts"), None), Change(("no", "table"), None))
    assert tables["drive"] == {}


def test_a_key_below_a_value_is_refused():
    with pytest.raises(ConfigError, match=r"drive.counts.low"):
        edit(TEXT, [Change(("drive", "counts", "low"), 1)])
