"""Access to the page: names of this computer, origins, tokens and roles.

A browser is a friend with bad company: any page it shows may send requests to any address. So only
requests whose Host names this computer are answered (DNS rebinding), and only pages of our own
origin may open a socket or post. Where others than this computer's programs reach the server, a
token is needed, too: one to look, one to drive. It comes in the fragment of a link, which browsers
send nobody, and is exchanged for a cookie that pages cannot read.
"""

from __future__ import annotations

import enum
import hashlib
import hmac
import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from robotctl.web.config import LOOPBACK_NAMES

TOKEN_BYTES: Final = 32

HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
        "connect-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
"""Headers of every answer."""


class Role(enum.StrEnum):
    """Rights of a client."""

    LOOK = "look"
    DRIVE = "drive"


@dataclass(frozen=True, slots=True)
class Asker:
    """Address and headers of a request.

    Parameters
    ----------
    server
        Address of this computer that it reached.
    host, origin
        Its headers; None: missing.
    cookies
        Its cookies.
    """

    server: str
    host: str | None
    origin: str | None
    cookies: Mapping[str, str]


class Access:
    """Rules of one server.

    Parameters
    ----------
    tokens
        Token of each role; empty where only this computer reaches the server: all may drive.
    allowed_hosts
        Names of this computer besides its addresses.
    port
        Port of the server.
    is_https
        Whether it is reached by TLS.
    """

    def __init__(
        self,
        tokens: Mapping[Role, str],
        allowed_hosts: tuple[str, ...],
        port: int,
        *,
        is_https: bool = False,
    ) -> None:
        self._tokens = tokens
        self._allowed = frozenset(name.lower() for name in allowed_hosts)
        self._port = port
        self._scheme = "https" if is_https else "http"
        self.cookie = f"robotctl-{port}"
        """Name of the cookie: one computer may have several robots, and ports share cookies."""
        self._of_cookie = {_cookie(token): role for role, token in tokens.items()}

    def objection(self, asker: Asker, *, needs_origin: bool) -> str:
        """Return why a request is not answered at all; empty: it is.

        Parameters
        ----------
        asker
            Where it came from.
        needs_origin
            Whether it does more than to read: browsers name the origin of those.
        """
        host = asker.host or ""
        name, port = _split(host)
        if port != self._port or not self._is_ours(name, asker.server):
            return f"Host {host!r} is no name of this robot: see web.allowed_hosts"
        if asker.origin is None:
            return "Origin is missing" if needs_origin else ""
        if asker.origin.lower() != f"{self._scheme}://{host}".lower():
            return f"Origin {asker.origin!r} is another page"
        return ""

    def role(self, asker: Asker) -> Role | None:
        """Return the role of a request by its cookie; None: it has none."""
        if not self._tokens:
            return Role.DRIVE
        return _find(self._of_cookie, asker.cookies.get(self.cookie, ""))

    def exchange(self, token: str) -> tuple[Role, str] | None:
        """Return role and cookie for a token; None: it is none."""
        role = _find({value: role for role, value in self._tokens.items()}, token)
        return None if role is None else (role, _cookie(self._tokens[role]))

    def _is_ours(self, name: str, server: str) -> bool:
        """Return whether a name in Host is one of this computer."""
        if name in self._allowed:
            return True
        address = address_of(server)
        if name in LOOPBACK_NAMES:
            return address is not None and address.is_loopback
        return address is not None and address_of(name) == address


def address_of(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Return an address of IP; None: the text is a name."""
    try:
        return ipaddress.ip_address(text)
    except ValueError:
        return None


def _split(host: str) -> tuple[str, int]:
    """Return name and port of a Host header; port -1: it is none."""
    try:
        parts = urlsplit(f"//{host}")
        if parts.netloc != host or parts.username is not None or parts.password is not None:
            return "", -1
        return (parts.hostname or "").rstrip("."), parts.port or 80
    except ValueError:
        return "", -1


def _cookie(token: str) -> str:
    """Return the cookie of a token, from which that cannot be found."""
    return hmac.digest(token.encode(), b"robotctl cookie", hashlib.sha256).hex()


def _find(roles: Mapping[str, Role], secret: str) -> Role | None:
    """Return the role of a secret in a time that does not depend on it."""
    found: Role | None = None
    for known, role in roles.items():
        if hmac.compare_digest(known.encode(), secret.encode(errors="replace")):
            found = role
    return found
