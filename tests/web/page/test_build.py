"""The built page is that of its source, and its types are those of the messages."""

from __future__ import annotations

import base64
import subprocess
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

import write_page_types
from tests.web.page.node_program import SOURCE, node_program
from tests.web.page.served_robot import STATIC

ANSWER = """
const plain = (key, value) => (value instanceof Uint8Array ? { bytes: [...value] } : value);
function answer(line) {
  return JSON.stringify(part.decode(new Uint8Array(Buffer.from(line, "base64"))), plain);
}
"""


def node(*command: str, cwd: Path = SOURCE) -> None:
    """Run a program of node; its output is shown where it fails."""
    done = subprocess.run(["node", *command], cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_types_are_those_of_the_messages():
    assert write_page_types.TARGET.read_text() == write_page_types.text(), (
        f"{write_page_types.TARGET} is old: run tools/write_page_types.py, then make page"
    )


@pytest.mark.node
def test_the_source_passes_the_type_check():
    node("node_modules/typescript/bin/tsc", "--noEmit")


@pytest.mark.node
def test_a_rebuild_gives_the_same_bytes(tmp_path):
    node("build.mjs", str(tmp_path / "static"))
    built = {path.name: path.read_bytes() for path in (tmp_path / "static").iterdir()}
    shipped = {path.name: path.read_bytes() for path in STATIC.iterdir()}
    assert built.keys() == shipped.keys()
    assert [name for name in built if built[name] != shipped[name]] == [], "run make page"


@pytest.fixture(scope="module")
def decoder(tmp_path_factory):
    """The page's decoder of MessagePack, which is asked in base64."""
    with node_program("wire/msgpack.ts", ANSWER, tmp_path_factory.mktemp("node")) as program:
        yield lambda value, **parsing: program.ask(
            base64.b64encode(msgspec.msgpack.encode(value)).decode(), **parsing
        )


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False).filter(lambda x: x != 0)  # -0 is 0 in JSON
    | st.text(max_size=300)
    | st.binary(max_size=300),
    lambda inner: (
        st.lists(inner, max_size=20)
        | st.dictionaries(st.text().filter(lambda key: key != "__proto__"), inner, max_size=20)
    ),
    max_leaves=30,
)


@pytest.mark.node
@given(VALUES)
def test_the_page_decodes_what_msgspec_encodes(decoder, value):
    def plain(found):
        if isinstance(found, bytes):
            return {"bytes": list(found)}
        if isinstance(found, list):
            return [plain(each) for each in found]
        if isinstance(found, dict):
            return {key: plain(each) for key, each in found.items()}
        return found

    # JSON of a page has no whole numbers apart from others.
    assert decoder(value, parse_int=float) == plain(value)


@pytest.mark.node
@pytest.mark.parametrize("count", [15, 16, 65535, 65536])
def test_the_page_decodes_long_arrays_texts_and_binaries(decoder, count):
    value = [[1] * count, "é" * count, count.to_bytes(4, "little") * count, {"a": -count}]
    numbers, text, binary, entries = decoder(value)
    assert (numbers, text, bytes(binary["bytes"]), entries) == tuple(value)
