"""Who is let in: names of this computer, origins, tokens."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from robotctl.web.access import Access, Asker, Role

TOKENS = {Role.LOOK: "look" * 11, Role.DRIVE: "drive" * 9}


def asker(host, origin=None, server="127.0.0.1", **cookies) -> Asker:
    return Asker(server, host, origin, cookies)


LOCAL = Access({}, (), 8080)
OPEN = Access(TOKENS, ("robot.lan",), 8080)


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080"])
def test_names_of_this_computer_are_answered_on_it(host):
    assert LOCAL.objection(asker(host), needs_origin=False) == ""


def test_the_v6_loopback_is_one_too():
    assert LOCAL.objection(asker("[::1]:8080", server="::1"), needs_origin=False) == ""


@pytest.mark.parametrize(
    "host",
    [None, "", "evil.example:8080", "127.0.0.1", "127.0.0.1:8081", "localhost.evil.example:8080",
     "127.0.0.1:8080@evil.example", "user@127.0.0.1:8080", "127.0.0.1:8080/", "2130706433:8080",
     "127.1:8080", "192.168.1.5:8080", "[::1:8080", "127.0.0.1:99999", "robot.lan:8080"],
)  # fmt: skip
def test_other_names_are_not(host):
    assert "no name of this robot" in LOCAL.objection(asker(host), needs_origin=False)


@given(st.text(max_size=40))
@example("127.0.0.1:8080\r\n")
@example("127.0.0.1:8080 ")
def test_no_other_host_than_the_listed_ones_passes(host):
    passes = LOCAL.objection(asker(host), needs_origin=False) == ""
    assert passes == (host.lower() in {"127.0.0.1:8080", "localhost:8080"})


def test_an_address_counts_where_the_request_arrived_there():
    here = asker("192.168.1.5:8080", server="192.168.1.5")
    assert OPEN.objection(here, needs_origin=False) == ""
    elsewhere = asker("192.168.1.6:8080", server="192.168.1.5")
    assert OPEN.objection(elsewhere, needs_origin=False)
    assert OPEN.objection(asker("localhost:8080", server="192.168.1.5"), needs_origin=False)
    assert OPEN.objection(asker("robot.lan:8080", server="192.168.1.5"), needs_origin=False) == ""


@pytest.mark.parametrize(
    "origin",
    ["https://evil.example", "null", "http://127.0.0.1", "http://127.0.0.1:8081", "",
     "https://127.0.0.1:8080", "http://localhost:8080", "http://127.0.0.1:8080.evil.example"],
)  # fmt: skip
def test_other_origins_are_refused_even_where_none_is_needed(origin):
    for needed in (True, False):
        assert "Origin" in LOCAL.objection(asker("127.0.0.1:8080", origin), needs_origin=needed)


def test_what_changes_something_needs_an_origin():
    assert "missing" in LOCAL.objection(asker("127.0.0.1:8080"), needs_origin=True)
    mine = asker("127.0.0.1:8080", "http://127.0.0.1:8080")
    assert LOCAL.objection(mine, needs_origin=True) == ""


@pytest.mark.parametrize("role", Role)
def test_a_token_gives_its_role_by_a_cookie_that_is_not_the_token(role):
    given_role, cookie = OPEN.exchange(TOKENS[role])
    assert given_role is role
    assert TOKENS[role] not in cookie
    assert OPEN.role(asker("robot.lan:8080", **{OPEN.cookie: cookie})) is role
    assert OPEN.role(asker("robot.lan:8080", **{OPEN.cookie: TOKENS[role]})) is None


@given(st.text(max_size=60))
def test_nothing_else_is_a_token_or_a_cookie(text):
    assert OPEN.exchange(text) is None
    assert OPEN.role(asker("robot.lan:8080", **{OPEN.cookie: text})) is None


def test_where_only_this_computer_comes_all_may_drive_and_no_token_counts():
    assert LOCAL.role(asker("127.0.0.1:8080")) is Role.DRIVE
    assert LOCAL.exchange("") is None
