"""Parts of the page's source in node: a line of text goes in, a line of JSON comes out."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.web.page.served_robot import STATIC

SOURCE = STATIC.parent / "page"

_PROGRAM = """
import {{ createInterface }} from "node:readline";
import * as part from "./part.mjs";
{answer}
for await (const line of createInterface({{ input: process.stdin }})) {{
  console.log(answer(line));
}}
"""


class NodeProgram:
    """A running program."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process

    def ask(self, line: str, **parsing: Any) -> Any:
        """Return the program's answer to a line."""
        self._process.stdin.write(line.encode() + b"\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline(), **parsing)


@contextmanager
def node_program(part: str, answer: str, folder: Path) -> Iterator[NodeProgram]:
    """Run a part of the source, which a function `answer` of JavaScript asks, in a folder."""
    esbuild = SOURCE / "node_modules" / "esbuild" / "bin" / "esbuild"
    command = [esbuild, SOURCE / "src" / part, "--bundle", "--format=esm"]
    subprocess.run([*command, f"--outfile={folder / 'part.mjs'}"], check=True, capture_output=True)
    (folder / "program.mjs").write_text(_PROGRAM.format(answer=answer))
    with subprocess.Popen(
        ["node", folder / "program.mjs"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        yield NodeProgram(process)
        process.stdin.close()
