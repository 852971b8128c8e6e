"""The key's file and the time stamps of before."""

import hashlib

import pytest

from robotctl.app.signing_files import SAVE_NS, SigningFiles, read_key, write_new_key
from robotctl.config.options import StackOptions
from robotctl.errors import ConfigError
from robotctl.mavlink.config import MavlinkConfig
from robotctl.messages.mavlink_port import LinkConfig

KEY = bytes(range(32))


def files(path, tmp_path, *, safe=False):
    link = LinkConfig("udpin:127.0.0.1:14550", safe=safe)
    config = MavlinkConfig(link=(link,), signing_key=str(path))
    return SigningFiles(config, StackOptions("x", "", state=str(tmp_path)))


def test_a_new_key_is_its_owners_alone_and_that_of_its_phrase(tmp_path):
    path = tmp_path / "mavlink.key"
    phrase = write_new_key(path)
    assert path.stat().st_mode & 0o777 == 0o600
    assert read_key(path) == hashlib.sha256(phrase.encode()).digest()
    with pytest.raises(ConfigError, match="exists"):
        write_new_key(path)


@pytest.mark.parametrize(
    ("content", "mode", "why"),
    [(KEY.hex(), 0o640, "0640"), ("short", 0o600, "5 characters"), ("", 0o600, "0 characters")],
)
def test_a_key_that_others_can_read_or_that_is_none_is_refused(tmp_path, content, mode, why):
    path = tmp_path / "mavlink.key"
    path.write_text(content)
    path.chmod(mode)
    with pytest.raises(ConfigError, match=why):
        files(path, tmp_path)


def test_a_missing_key_is_refused_unless_it_may_come_over_a_safe_link(tmp_path):
    path = tmp_path / "mavlink.key"
    with pytest.raises(ConfigError, match="keygen"):
        files(path, tmp_path)
    waiting = files(path, tmp_path, safe=True)
    assert waiting.signing.key is not None
    assert waiting.signing.key != KEY
    assert waiting.take_key(KEY, 5) == ""
    assert path.stat().st_mode & 0o777 == 0o600
    assert files(path, tmp_path).signing.key == KEY
    assert SigningFiles(MavlinkConfig(), StackOptions("x", "")).take_key(KEY, 5)


def test_time_stamps_go_on_after_a_restart(tmp_path):
    path = tmp_path / "mavlink.key"
    path.write_text(KEY.hex())
    path.chmod(0o600)
    first = files(path, tmp_path)
    stamp = first.signing.next_stamp()
    first.save(SAVE_NS)
    again = files(path, tmp_path)
    assert again.signing.stamp > stamp
