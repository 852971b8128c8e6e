"""A key over MAVLink: over safe links alone."""

from pymavlink.dialects.v20 import common as m

from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.mavlink_port import LinkConfig, Peer

KEY = bytes(range(32))


def test_a_key_comes_over_a_safe_link_alone(make_bench):
    links = LinkConfig("udpin:127.0.0.1:1"), LinkConfig("serial:/dev/ttyACM0:57600", safe=True)
    bench = make_bench(links=2, link=links)
    keys = []

    def take_key(key, stamp):
        keys.append((key, stamp))
        return ""

    bench.telemetry = Telemetry(bench.config, bench.robot, bench.links, take_key=take_key)

    def said(key, link):
        setup = m.MAVLink_setup_signing_message(1, 1, list(key), 7)
        bench.receive(setup, peer=Peer(link, 0))
        bench.step()
        return next(text for text in bench.texts() if text.startswith("Signing"))

    assert "safe" in said(KEY, 0)
    assert "switched off" in said(bytes(32), 1)
    assert keys == []
    assert "taken" in said(KEY, 1)
    assert keys == [(KEY, 7)]
