"""The web process: where it listens, what it says of itself, what it makes of a robot's file."""

from __future__ import annotations

import contextlib
import socket
import stat

import pytest

from robotctl.app.processes.web import links_of, outline_of, secrets_of
from robotctl.cli.arguments import web_settings
from robotctl.cli.web import words
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError, DiskError, LinkError
from robotctl.runtime.ipc.topics import Endpoints
from robotctl.web.access import Role
from robotctl.web.config import WebConfig
from robotctl.web.links import read_links, write_links
from robotctl.web.listening import PORTS, listen

ROBOTS = ("diff_drive", "mecanum", "ackermann")


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_page_is_told_a_robots_body_and_limits(robot):
    config = load_robot(find_file(robot))
    outline = outline_of(config, simulated=False)
    assert outline.holonomic == config.drive.holonomic
    assert (outline.v_max_m_s, outline.vy_max_m_s) == (
        config.limits.v_max_m_s,
        config.limits.vy_max_m_s,
    )
    (((*corners,),),) = outline.bodies
    assert len(corners) == 4
    xs, ys = zip(*corners, strict=True)
    for sonar in config.sonar:
        assert min(xs) <= sonar.x_m <= max(xs)
        assert min(ys) <= sonar.y_m <= max(ys)


def test_a_port_that_is_taken_leads_to_the_next_free_one_which_is_said():
    with listen(WebConfig(port=0)) as taken:
        port = taken.getsockname()[1]
        config = WebConfig(port=port)
        with listen(config) as listener:
            found = listener.getsockname()[1]
            assert port < found < port + PORTS
            (remark,) = links_of(config, secrets_of(config, None), found).remarks
            assert str(port) in remark
            assert str(found) in remark


def test_a_process_that_starts_again_has_its_port_again():
    with listen(WebConfig(port=0)) as before:
        port = before.getsockname()[1]
    with listen(WebConfig(port=8080), port) as again:
        assert again.getsockname()[1] == port


def test_an_address_of_another_computer_cannot_be_listened_at():
    with pytest.raises(LinkError, match=r"192\.0\.2\.77"):
        listen(WebConfig(host="192.0.2.77", port=0))


def test_what_the_kernel_keeps_for_a_slow_client_is_bounded():
    with listen(WebConfig(port=0)) as listener:
        address = listener.getsockname()
        with socket.create_connection(address), contextlib.closing(listener.accept()[0]) as side:
            assert side.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) <= 1 << 18
            assert side.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 10_000


def test_only_what_others_reach_has_tokens(tmp_path):
    assert secrets_of(WebConfig(), tmp_path).tokens == {}
    assert list(tmp_path.iterdir()) == []
    config = WebConfig(host="0.0.0.0")
    secrets = secrets_of(config, tmp_path)
    links = links_of(config, secrets, 8080)
    assert links.drive.endswith(f"/#token={secrets.tokens[Role.DRIVE]}")
    assert links.look.endswith(f"/#token={secrets.tokens[Role.LOOK]}")
    assert "token" not in links.address
    assert any("not encrypted" in remark for remark in links.remarks)
    assert not any(token in " ".join(links.remarks) for token in secrets.tokens.values())


def test_a_certificate_that_is_missing_is_named(tmp_path):
    config = WebConfig(tls=True, certificate="/none/c.pem", key="/none/k.pem")
    with pytest.raises(DiskError, match=r"/none/c\.pem"):
        links_of(config, secrets_of(config, tmp_path), 8080)


def test_links_are_for_their_user_alone_and_are_printed_with_a_code_for_phones(tmp_path):
    path = Endpoints(tmp_path).web_links
    assert read_links(path) is None
    config = WebConfig(host="0.0.0.0", tls=True)
    links = links_of(config, secrets_of(config, tmp_path), 8080)
    write_links(path, links)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert read_links(path) == links
    text = words(links)
    assert links.drive in text
    assert links.fingerprint in text
    assert "▄" in text
    assert links.look in words(links, look=True)
    assert links.drive not in words(links, look=True)


@pytest.mark.parametrize("address", ["8080", ":8080", "127.0.0.1", "127.0.0.1:", "a:b", "a:-1"])
def test_web_needs_a_host_and_a_port(address):
    with pytest.raises(ConfigError, match="HOST:PORT"):
        web_settings(address)


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        (web_settings("robot.lan:8080"), "web.host"),
        (web_settings("127.0.0.1:65536"), "web.port"),
        (('web.certificate="/a.pem"',), "web.key"),
        (('web.certificate="a.pem"', 'web.key="/b.pem"'), "web.certificate"),
    ],
)
def test_a_wrong_setting_is_named(settings, key):
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")):
        load_robot(find_file("diff_drive"), settings)


def test_an_address_of_version_6_is_taken_in_brackets():
    config = load_robot(find_file("diff_drive"), web_settings("[::1]:8080"))
    assert (config.web.host, config.web.port) == ("::1", 8080)
    assert config.web.is_loopback
