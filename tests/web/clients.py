"""Foreign clients of the page's server, as its tests use them."""

from __future__ import annotations

import json
import time

import httpx
import pytest
from websockets.exceptions import InvalidStatus

from robotctl.web.access import Role

TOKENS = {Role.LOOK: "look" * 11, Role.DRIVE: "drive" * 9}


def wait(condition, seconds=5.0, what=""):
    deadline_s = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < deadline_s, what or "did not happen in time"
        time.sleep(0.002)
    return result


def of(requests, kind):
    return [each for each in requests if isinstance(each, kind)]


def get(served, path="/", **headers):
    return httpx.get(f"{served.url}{path}", headers=headers, verify=False, trust_env=False)


def refused(served, path="/live", **options) -> str:
    with pytest.raises(InvalidStatus) as error:
        served.client(path, **options)
    assert error.value.response.status_code == 403
    return error.value.response.body.decode()


def drive(client, seconds, sample=0, held=True, **axes):
    """Hold the sticks at 20 Hz; return the next sample number."""
    end_s = time.monotonic() + seconds
    axes = {"forward": 0.5, "turn": 0.0, "sideways": 0.0, **axes}
    while time.monotonic() < end_s:
        client.send("Sticks", sample=sample, at_ms=client.at_ms(), held=held, **axes)
        sample += 1
        time.sleep(0.05)
    return sample


def take_over(client) -> None:
    client.synchronise()
    client.send("TakeDriving", id=1, at_ms=client.at_ms())
    client.read("Driver", where=lambda message: message["client"] is not None)


def cookie_of(served, role) -> str:
    answer = httpx.post(
        f"{served.url}/session",
        content=json.dumps({"token": TOKENS[role]}),
        headers={"Origin": served.url},
        trust_env=False,
    )
    assert (answer.status_code, answer.text) == (200, role)
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    return cookie.partition(";")[0]
