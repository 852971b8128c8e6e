"""URLs of links and the [mavlink] section."""

import math
import tomllib
from pathlib import Path

import pydantic
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl import toml_source
from robotctl.errors import ConfigError
from robotctl.mavlink.config import MavlinkConfig, StreamRates
from robotctl.messages.mavlink_port import LinkConfig, parse_link_url

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize(
    ("url", "parts"),
    [
        ("udpout:127.0.0.1:14550", ("udpout", "127.0.0.1", 14550)),
        ("udpin:0.0.0.0:14550", ("udpin", "0.0.0.0", 14550)),
        ("tcpin:localhost:0", ("tcpin", "localhost", 0)),
        ("tcpout:gcs.local:5760", ("tcpout", "gcs.local", 5760)),
        ("udpout:[::1]:14550", ("udpout", "::1", 14550)),
        ("serial:/dev/ttyUSB0:57600", ("serial", "/dev/ttyUSB0", 57600)),
        (
            "serial:/dev/serial/by-id/usb:1-2:115200",
            ("serial", "/dev/serial/by-id/usb:1-2", 115200),
        ),
    ],
)
def test_each_form_of_url_is_taken_apart(url, parts):
    assert LinkConfig(url).address == parts


@pytest.mark.parametrize(
    ("url", "complaint"),
    [
        ("udp:127.0.0.1:14550", 'did you mean "udp'),
        ("upd:127.0.0.1:14550", "no kind of link"),
        ("udpout:127.0.0.1", "needs a host and a port"),
        ("udpout::14550", "needs a host and a port"),
        ("udpout:127.0.0.1:0", "port 0 is not in 1 to 65535"),
        ("tcpin:127.0.0.1:65536", "port 65536 is not in 0 to 65535"),
        ("tcpin:127.0.0.1:-1", "needs a host and a port"),
        ("udpout:::1:14550", "needs a host and a port"),
        ("serial:ttyUSB0:57600", "needs a device path and a baud rate"),
        ("serial:/dev/ttyUSB0", "needs a device path and a baud rate"),
        ("serial:/dev/ttyUSB0:0", "baud rate 0"),
        ("", "no kind of link"),
    ],
)
def test_a_wrong_url_is_refused_with_all_allowed_forms(url, complaint):
    with pytest.raises(
        ValueError, match=r"allowed: udpout:HOST:PORT, .*serial:/dev/NAME:BAUD"
    ) as no:
        LinkConfig(url)
    assert complaint in str(no.value)


@pytest.mark.parametrize(
    "host",
    [
        "192.168.1..20",
        ".local",
        ".",
        "gcs..",
        "a" * 64,
        "gcs." + "a" * 64 + ".local",
        "\u00fc" * 60,
    ],
)
def test_a_host_that_cannot_be_one_is_refused_with_what_is_allowed(host):
    url = f"udpout:{host}:14550"
    for read in (parse_link_url, LinkConfig):
        with pytest.raises(ValueError, match="is no host; allowed: an IPv4 address, an IPv6") as no:
            read(url)
        assert f'"{url}": "{host}"' in str(no.value)


@pytest.mark.parametrize(
    "url",
    [
        "udpout:gcs.local.:14550",
        "udpout:[fe80::1%eth0]:14550",
        "udpin:0.0.0.0:14550",
        "tcpout:" + "a" * 63 + ".local:5760",
        "tcpout:b\u00fcro.local:5760",
        "serial:/dev/serial/by-id/" + "a" * 70 + "..b:57600",
    ],
)
def test_hosts_that_may_exist_are_taken(url):
    assert LinkConfig(url).url == url


@given(st.text(max_size=40))
def test_any_text_is_a_link_or_a_value_error(text):
    try:
        url = LinkConfig(text).url
    except ValueError:
        return
    assert url == text


def test_the_section_of_the_default_robot_loads():
    section = tomllib.loads((CONFIGS / "diff_drive.toml").read_text())["mavlink"]
    config = pydantic.TypeAdapter(MavlinkConfig).validate_python(section)
    assert [link.address.kind for link in config.link] == ["udpout", "tcpin"]
    assert config.rates == StreamRates()


def test_errors_of_a_file_become_config_errors_with_their_lines():
    text = '[[link]]\nurl = "tpcin:127.0.0.1:5760"\n[rates]\nattitude_hz = -1.0\n'
    with pytest.raises(ConfigError) as refused:
        toml_source.parse(text, MavlinkConfig, "robot.toml")
    message = str(refused.value)
    assert 'robot.toml:2: link[0].url: "tpcin:127.0.0.1:5760": "tpcin" is no kind' in message
    assert 'did you mean "tcpin"' in message
    assert "robot.toml:4: rates.attitude_hz: must be 0 (off) or 0.001 to 100, not -1.0" in message


def test_a_host_that_cannot_be_one_is_a_config_error_with_its_line():
    text = '[[link]]\nurl = "tcpin:127.0.0.1:5760"\n[[link]]\nurl = "udpout:gcs..local:14550"\n'
    with pytest.raises(ConfigError) as refused:
        toml_source.parse(text, MavlinkConfig, "robot.toml")
    (line,) = str(refused.value).splitlines()
    assert line.startswith("robot.toml:4: link[1].url: ")
    assert '"udpout:gcs..local:14550": "gcs..local" is no host; allowed: ' in line


@pytest.mark.parametrize(
    "wrong",
    [
        {"system_id": 0},
        {"component_id": 256},
        {"setpoint_timeout_s": 0.0},
        {"setpoint_timeout_s": math.nan},
        {"gcs_timeout_s": math.inf},
        {"hold_without_gcs": True},
        {"link": (LinkConfig("tcpin:h:1"), LinkConfig("tcpin:h:1"))},
    ],
)
def test_values_out_of_range_are_refused_by_name(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        MavlinkConfig(**wrong)


@pytest.mark.parametrize("rate", [-1.0, 1e-300, 0.0009, 101.0, math.nan, math.inf])
def test_rates_are_0_or_between_a_thousandth_and_100_hz(rate):
    with pytest.raises(ValueError, match=r"sonar_hz must be 0 \(off\) or 0\.001 to 100"):
        StreamRates(sonar_hz=rate)


@pytest.mark.parametrize("rate", [0.0, 0.001, 100.0])
def test_the_rates_at_the_ends_are_allowed(rate):
    assert StreamRates(sonar_hz=rate).sonar_hz == rate
