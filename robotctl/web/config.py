"""Configuration of the web page, the `[web]` section of a robot's file."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass

from robotctl.errors import InvalidValue

LAST_PORT = 65535
LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})


@dataclass(frozen=True, slots=True)
class WebConfig:
    """Address of the web page, and who may open it.

    Parameters
    ----------
    enabled : bool
        Whether the robot serves the page.
    host : str
        Address that is listened at: 127.0.0.1, for browsers of the same computer only, another of
        its addresses, or 0.0.0.0 for all of them. Anything but the first needs a token, which
        robotctl makes.
    port : int
        Port of TCP, 0 to 65535; 0: any. Where it is taken, the next free one.
    allowed_hosts : tuple of str
        Names of this computer under which a browser may open the page, besides its addresses.
    tls : bool
        Whether the page is served by HTTPS.
    certificate, key : str
        Files with a certificate and its private key (PEM), absolute paths; empty: one is made.
    foxglove : bool
        Whether Foxglove can watch the robot live, at port 8765 of `host`, whether or not the page
        is enabled. Its protocol has no token, so `host` must be 127.0.0.1.

    Raises
    ------
    ValueError
        If a value is out of range, or one of two files is missing.
    """

    enabled: bool = False
    host: str = "127.0.0.1"
    port: int = 8080
    allowed_hosts: tuple[str, ...] = ()
    tls: bool = False
    certificate: str = ""
    key: str = ""
    foxglove: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.port <= LAST_PORT:
            raise InvalidValue("port", f"must be 0 to {LAST_PORT}, not {self.port}", self.port)
        if self.host != "localhost":
            try:
                ipaddress.ip_address(self.host)
            except ValueError:
                rule = f"must be an address such as 127.0.0.1 or 0.0.0.0, not {self.host!r}"
                raise InvalidValue("host", rule, self.host) from None
        for name in ("certificate", "key"):
            path = getattr(self, name)
            if path and not path.startswith("/"):
                raise InvalidValue(name, f"{path} found, an absolute path allowed", path)
        if bool(self.certificate) != bool(self.key):
            missing = "key" if self.certificate else "certificate"
            raise InvalidValue(missing, "missing: certificate and key belong together", "")
        if self.foxglove and not self.is_loopback:
            rule = (
                f"must be false while host is {self.host}: Foxglove's protocol has no token; set "
                "host to 127.0.0.1 and come through ssh -L 8765:127.0.0.1:8765"
            )
            raise InvalidValue("foxglove", rule, self.foxglove)

    @property
    def is_loopback(self) -> bool:
        """Whether only programs of this computer reach the page."""
        return self.host == "localhost" or ipaddress.ip_address(self.host).is_loopback
