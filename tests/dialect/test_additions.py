"""What the dialect adds has MAVLink's published layout, and is what pymavlink's generator makes."""

import contextlib
import importlib.util
import io

import pytest
from pymavlink.dialects.v20 import common
from pymavlink.generator import mavgen, mavparse

from robotctl.dialect import additions
from write_dialect import BUNDLED, SOURCE, TARGET, written

PUBLISHED = {
    "COMMAND_CANCEL": (80, 14, 4),
    "EKF_STATUS_REPORT": (193, 71, 26),
    "ESC_INFO": (290, 251, 46),
    "ESC_STATUS": (291, 10, 57),
    "PROTOCOL_VERSION": (300, 217, 22),
    "BATTERY_INFO": (372, 26, 140),
    "COMPONENT_METADATA": (397, 182, 108),
    "EVENT": (410, 160, 53),
    "CURRENT_EVENT_SEQUENCE": (411, 106, 3),
    "REQUEST_EVENT": (412, 33, 6),
    "RESPONSE_EVENT_ERROR": (413, 77, 7),
    "AVAILABLE_MODES": (435, 134, 46),
    "CURRENT_MODE": (436, 193, 9),
    "AVAILABLE_MODES_MONITOR": (437, 30, 1),
}
"""Number, CRC_EXTRA and length [B]: MAVLINK_MESSAGE_CRCS of common.h, and the `_CRC` and `_LEN` of
mavlink_msg_*.h, and of ardupilotmega for EKF_STATUS_REPORT, in MAVLink's C library
(https://github.com/mavlink/c_library_v2)."""


def test_the_messages_have_the_published_numbers_checksums_and_lengths():
    found = {
        each.msgname: (each.id, each.crc_extra, each.unpacker.size)
        for each in additions.MESSAGES.values()
    }
    assert found == PUBLISHED


def test_the_module_is_written_from_the_xml():
    assert TARGET.read_text(encoding="utf-8") == written(), "run tools/write_dialect.py"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the module that `mavgen` makes of the XML with all that it includes."""
    folder = tmp_path_factory.mktemp("dialect")
    for path in [*BUNDLED.glob("*.xml"), SOURCE]:
        (folder / path.name).symlink_to(path)
    options = mavgen.Opts(
        str(folder / "whole.py"), mavparse.PROTOCOL_2_0, language="Python3", validate=False
    )
    with contextlib.redirect_stdout(io.StringIO()):
        assert mavgen.mavgen(options, [str(folder / SOURCE.name)])
    spec = importlib.util.spec_from_file_location("whole", folder / "whole.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_it_is_what_the_generator_makes_of_the_whole_dialect(whole):
    layout = ("crc_extra", "fieldnames", "orders", "lengths", "array_lengths", "native_format")
    for number, ours in additions.MESSAGES.items():
        theirs = whole.mavlink_map[number]
        for name in layout:
            assert getattr(ours, name) == getattr(theirs, name), (ours.msgname, name)
    for name, value in vars(additions).items():
        if name.startswith(("MAV_", "ESC_", "MAVLINK_")):
            assert getattr(whole, name) == value, name


@pytest.mark.parametrize("number", sorted(additions.MESSAGES))
def test_the_robots_codec_reads_what_another_wrote(whole, number):
    theirs = whole.mavlink_map[number]
    values = [
        bytes(range(65, 65 + length))
        if kind == "char"
        else [float(k) if kind == "float" else k for k in range(1, length + 1)]
        if length
        else 3
        for kind, length in zip(
            theirs.fieldtypes,
            [theirs.array_lengths[place] for place in theirs.orders],
            strict=True,
        )
    ]
    frame = theirs(*values).pack(whole.MAVLink(None, 7, 8))
    message = common.MAVLink(None).decode(bytearray(frame))
    assert type(message) is additions.MESSAGES[number]
    assert message.pack(common.MAVLink(None, 7, 8)) == frame
