"""Tokens and certificate of a robot's page: made once, kept in private files."""

from __future__ import annotations

import datetime as dt
import hashlib
import secrets
import ssl
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from robotctl.errors import DiskError
from robotctl.web.access import TOKEN_BYTES, Role, address_of
from robotctl.web.links import write_private

TOKENS: Final = "web.tokens"
CERTIFICATE: Final = "web.pem"
_VALID_DAYS: Final = 820
"""Browsers refuse certificates of more than 825 days."""
_RENEWED_DAYS: Final = 790


def tokens_of(folder: Path) -> dict[Role, str]:
    """Return the tokens of a robot, made where there are none; delete the file for new ones.

    Raises
    ------
    DiskError
        If they cannot be kept, or the file is open to others.
    """
    path = folder / TOKENS
    try:
        if path.exists():
            if path.stat().st_mode & 0o077:
                raise DiskError(f"{path}: open to others; remove it, and new tokens are made")
            kept = msgspec.json.decode(path.read_bytes(), type=dict[Role, str])
            if set(kept) == set(Role) and all(len(each) >= TOKEN_BYTES for each in kept.values()):
                return kept
        tokens = {role: secrets.token_urlsafe(TOKEN_BYTES) for role in Role}
        write_private(path, msgspec.json.encode(tokens))
    except (OSError, msgspec.DecodeError) as error:
        raise DiskError(f"{path}: no tokens for the web page: {error}") from error
    return tokens


def certificate_of(folder: Path, names: Sequence[str]) -> Path:
    """Return the file with the robot's own certificate and key, made where it is missing or old.

    Parameters
    ----------
    folder
        Where it is kept.
    names
        Names and addresses of this computer.

    Raises
    ------
    DiskError
        If it cannot be kept.
    """
    path = folder / CERTIFICATE
    try:
        if path.exists() and time.time() - path.stat().st_mtime < _RENEWED_DAYS * 86400:
            return path
        write_private(path, _self_signed(names))
    except OSError as error:
        raise DiskError(f"{path}: no certificate for the web page: {error}") from error
    return path


def fingerprint_of(certificate: Path) -> str:
    """Return the SHA-256 of the first certificate of a PEM file, as browsers show it.

    Raises
    ------
    DiskError
        If there is none.
    """
    try:
        text = certificate.read_text(encoding="ascii")
        end = "-----END CERTIFICATE-----"
        first = text[text.index("-----BEGIN CERTIFICATE-----") : text.index(end) + len(end)]
        digest = hashlib.sha256(ssl.PEM_cert_to_DER_cert(first)).hexdigest().upper()
    except (OSError, ValueError) as error:
        raise DiskError(f"{certificate}: no certificate (PEM): {error}") from error
    return ":".join(digest[at : at + 2] for at in range(0, len(digest), 2))


def _self_signed(names: Sequence[str]) -> bytes:
    """Return a new key (P-256) and a certificate of it, as PEM."""
    # 13 MB, which only the first start of a page with TLS needs.
    from cryptography import x509  # noqa: PLC0415
    from cryptography.hazmat.primitives import hashes, serialization  # noqa: PLC0415
    from cryptography.hazmat.primitives.asymmetric import ec  # noqa: PLC0415
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID  # noqa: PLC0415

    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "robotctl")])
    now = dt.datetime.now(dt.UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - dt.timedelta(days=1))
        .not_valid_after(now + dt.timedelta(days=_VALID_DAYS))
        .add_extension(
            x509.SubjectAlternativeName(
                [
                    x509.IPAddress(address)
                    if (address := address_of(name)) is not None
                    else x509.DNSName(name)
                    for name in names
                ]
            ),
            critical=False,
        )
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .sign(key, hashes.SHA256())
    )
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    ) + certificate.public_bytes(serialization.Encoding.PEM)
