"""EDS files and the table `[[motor]]`: what is taken, and what is refused in which words."""

import canopen
import pytest

from firmware_sim.drives.cia402.objects import objects_of
from firmware_sim.drives.cia402.settings import Cia402Settings
from robotctl.drivers.can.drives.axis import Axis, AxisConfig
from robotctl.drivers.can.drives.cia402.config import Cia402Motor
from robotctl.drivers.can.drives.cia402.eds import find_eds, load_eds
from robotctl.errors import InvalidValue
from robotctl.model.actuators import Takes
from tests.drivers.can.drives.cia402.rig import DIALECTS, FAKE_EDS, GENERIC, needs

ONE = (AxisConfig("left"),)


def motor(table=GENERIC, axes=ONE, **more):
    given = {"kind": "cia402", "name": "motors", "node_id": 5}
    return Cia402Motor(**{**given, **table, **more}, axes=axes)


def make(config, **changes):
    axes = tuple(Axis(axis, Takes.SPEED, 2400) for axis in config.axes)
    return config.make(axes, needs(**changes))


class TestEds:
    @pytest.mark.parametrize("path", [FAKE_EDS, str(find_eds("drives/cia402.eds"))])
    def test_objects_access_and_defaults_are_those_that_canopen_reads(self, path):
        ours, theirs = load_eds(find_eds(path)), canopen.import_od(path, node_id=None)
        compared = 0
        for each in theirs.values():
            for variable in each.values() if hasattr(each, "values") else [each]:
                key = variable.index, variable.subindex
                assert ours.objects[key].writable == variable.writable, key
                assert ours.objects[key].bits in (0, len(variable)), key
                if variable.default is not None and not variable.relative:
                    assert ours.objects[key].default == variable.default, key
                compared += 1
        assert compared == len(ours.objects) > 100

    def test_our_eds_describes_the_twin(self):
        eds = load_eds(find_eds("drives/cia402.eds"))
        objects = {
            variable.key: variable
            for each in objects_of("generic", 5, 2, Cia402Settings())
            for variable in each.variables
        }
        assert eds.objects.keys() == objects.keys()
        for key, found in eds.objects.items():
            assert found.writable == objects[key].access.writable, key
            assert found.bits == 8 * (objects[key].size or 0), key

    def test_compact_members_and_hexadecimal_in_any_case(self, tmp_path):
        path = tmp_path / "compact.eds"
        path.write_text(
            "[1016]\nObjectType=8\nDataType=0x0007\nAccessType=rw\nCompactSubObj=3\n"
            "[60ff]\nDataType=0x0004\nAccessType=RWW\nDefaultValue=0X10\n"
        )
        eds = load_eds(path)
        assert eds.can_write(0x1016, 3)
        assert not eds.has(0x1016, 4)
        assert (eds.can_write(0x60FF), eds.default(0x60FF)) == (True, 16)

    @pytest.mark.parametrize("text", ["", "no section\n", "[DeviceInfo]\nVendorNumber=1\n", "[[\n"])
    def test_a_file_that_is_none_is_refused_by_name(self, tmp_path, text):
        path = tmp_path / "bad.eds"
        path.write_text(text)
        with pytest.raises(InvalidValue, match=r"eds must .*bad\.eds"):
            motor(eds=str(path))


class TestTable:
    @pytest.mark.parametrize("table", DIALECTS.values(), ids=DIALECTS)
    def test_each_dialect_is_accepted(self, table):
        assert motor(table).node_ids == (5,)

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"eds": ""}, "eds must name the EDS of a generic drive, found ''"),
            ({"eds": "nowhere.eds"}, "no file 'nowhere.eds' found"),
            ({"node_id": 0}, "node_id must be 1 to 127, not 0"),
            ({"host_id": 5}, "host_id must not be the drive's, 5"),
            ({"counts_per_turn": 0}, "counts_per_turn must be above 0 with generic, not 0"),
            ({"axes": (AxisConfig("left"), AxisConfig("right"))}, "1 to 2 to itself, found 1, 1"),
            ({"axes": (AxisConfig("left", 3),)}, "1 to 2 to itself, found 3"),
            ({"dialect": "zlac8015d", "mode": "velocity"}, 'must be "profile_velocity" with zlac'),
        ],
    )
    def test_what_cannot_be_is_refused(self, changes, words):
        axes = changes.pop("axes", ONE)
        with pytest.raises(InvalidValue) as refused:
            motor(axes=axes, **changes)
        assert words in str(refused.value)

    def test_a_drive_that_does_not_say_that_it_stops_needs_the_line(self):
        for table in (
            {"eds": FAKE_EDS, "counts_per_turn": 4096},
            {"dialect": "roboteq", "counts_per_turn": 4096},
        ):
            config = motor(table)
            assert not config.abilities.stops_alone
            with pytest.raises(InvalidValue, match="accept_coasting must be true for this drive"):
                make(config)
            make(motor(table, accept_coasting=True))

    def test_those_that_do_need_none(self):
        for table in (GENERIC, DIALECTS["zlac8015d"]):
            config = motor(table)
            assert config.abilities.stops_alone
            make(config)

    def test_wheels_faster_than_the_drive_are_refused(self):
        fast = (AxisConfig("left", ratio=10.0),)
        with pytest.raises(InvalidValue, match=r"need a target velocity of 1910, .* at most 1000"):
            make(motor(DIALECTS["zlac8015d"], fast), max_rad_s=20.0)
        make(motor(DIALECTS["zlac8015d"], fast), max_rad_s=10.0)

    def test_abilities_are_what_is_told(self):
        generic, zlac = motor(GENERIC).abilities, motor(DIALECTS["zlac8015d"]).abilities
        fake = motor({"eds": FAKE_EDS, "counts_per_turn": 4096}).abilities
        assert (generic.tells_current, generic.tells_temperature, generic.tells_voltage) == (
            True, False, True,
        )  # fmt: skip
        assert (zlac.tells_current, zlac.tells_temperature, zlac.tells_voltage) == (True,) * 3
        assert (fake.tells_speed, fake.tells_current, fake.tells_voltage) == (True, False, False)
