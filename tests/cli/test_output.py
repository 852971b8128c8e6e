"""Output of commands on terminals that cannot show all characters."""

import os
from io import BytesIO, TextIOWrapper

from robotctl.cli.output import Output


def test_characters_that_an_encoding_has_not_are_written_plainly() -> None:
    assert printed("ascii", "0.4° · 38 µs × 2 … Zoë") == b"0.4 deg - 38 us x 2 ... Zo?"
    assert printed("cp437", "0.4° · 38 µs × 2 … Zoë").decode("cp437") == "0.4° · 38 µs x 2 ... Zoë"
    assert printed("ascii", os.fsdecode(b"caf\xe9.toml")) == b"caf\xe9.toml"
    assert printed("utf-8", os.fsdecode(b"caf\xe9 \xc2\xb0")) == b"caf\xe9 \xc2\xb0"


def test_errors_are_written_plainly_too_and_names_as_before() -> None:
    name = os.fsdecode(b"caf\xe9")
    assert printed("ascii", f"fitting … {name}", "backslashreplace") == rb"fitting ... caf\udce9"


def printed(encoding: str, text: str, errors: str = "strict") -> bytes:
    """Return what a stream of an encoding makes of a text."""
    stream = TextIOWrapper(BytesIO(), encoding, errors)
    output = Output(stream)
    output.write(text)
    output.flush()
    return stream.buffer.getvalue()
