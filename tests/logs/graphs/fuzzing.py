"""What `tools/fuzz.py` tries graph files on, how it changes them, and the inputs that it has found.

A corpus is a text file, an input in hexadecimal on each line, as in tests/mavlink/corpus.
"""

from __future__ import annotations

import gzip
import json
import random
import tempfile
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from robotctl.errors import RobotctlError
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.solvers.registry import CONSISTENT, IN_ORDER, SOLVERS
from robotctl.estimation.slam.start.registry import STARTS
from robotctl.logs.graphs.g2o import G2O
from robotctl.logs.graphs.g2o import TAGS as G2O_TAGS
from robotctl.logs.graphs.graph_files import read_graph
from robotctl.logs.graphs.gtsam_text import GTSAM
from robotctl.logs.graphs.gtsam_text import TAGS as GTSAM_TAGS
from robotctl.logs.graphs.toro import TAGS as TORO_TAGS
from robotctl.logs.graphs.toro import TORO
from robotctl.workbench.graphs.optimise import optimise, write_graph
from robotctl.workbench.graphs.options import OptimiseOptions

CORPUS = Path(__file__).parent / "corpus"
LONGEST = 2048
"""Bytes of an input."""

PLANE = "1 0 0 1 0 4"
SPACE = "9 0 0 0 0 0 9 0 0 0 0 9 0 0 0 4 0 0 4 0 4"
SEEDS = {
    "g2o": (
        f"""VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0.1 1.5
VERTEX_XY 9 2 2
FIX 0
EDGE_SE2 0 1 1 0 1.57 {PLANE}
EDGE_SE2 1 2 1 0 1.57 {PLANE}
EDGE_SE2 2 0 1 1 3.1 {PLANE}
EDGE_SE2_XY 0 9 2 2 5 0 5
EDGE_SE2_XY 1 9 2 -1 5 0 5
EDGE_BEARING_SE2_XY 2 9 0.3 20
EDGE_PRIOR_SE2 1 1 0 1.5 {PLANE}
EDGE_PRIOR_SE2_XY 2 1 1 7 0 7
EDGE_PRIOR_XY 9 2 2 1 0 1
""",
        f"""PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT -1 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 3 1 0 0 0 0 0.7071067811865475 0.7071067811865476
VERTEX_TRACKXYZ 8 1 2 3
EDGE_SE3:QUAT -1 3 1 0 0 0 0 0.7 0.7 {SPACE}
EDGE_SE3_TRACKXYZ 3 8 0 2 0 3 4 0 0 4 0 4
EDGE_SE3_PRIOR -1 0 0 0 0 0 0 0 1 {SPACE}
FIX 8
""",
    ),
    "toro": (
        """VERTEX2 0 0 0 0
VERTEX2 1 1 0 0.1
VERTEX2 2 1 1 1.6
EDGE2 0 1 1 0 0 1 0 1 4 0 0
EDGE2 1 2 0 1 1.5 1 0 1 4 0 0
EDGE2 2 3 1 0 0 1 0 1 4 0 0
EDGE2 3 0 1 1 3 1 0 1 4 0 0
EQUIV 3 1
""",
        f"""VERTEX3 0 0 0 0 0 0 0
VERTEX3 1 1 0 0 0.1 0.2 0.3
EDGE3 0 1 1 0 0 0 0 0.3
EDGE3 1 2 1 0 0 0.1 0 0 {SPACE}
""",
        """EDGE2 0 1 1 0 0.1 3.16228 0 0 3.16228 0 5
EDGE2 1 2 1 0 0.1 3.16228 0 0 3.16228 0 5
EDGE2 0 2 2 0 0.2 3.16228 0 0 3.16228 0 5
""",
    ),
    "gtsam": (
        """ODOMETRY 0 1 1 0 0 0.01 0 0 0.01 0 0.001
ODOMETRY 1 2 1 0 1 0.01 0 0 0.01 0 0.001
LANDMARK 0 1 2 1 0.01 0 0.01
LANDMARK 2 1 1 -1 0.01 0 0.01
BR 1 1 0.5 2 0.01 0.1
BR 1 2 -0.5 1 0.01 0.1
VERTEX2 0 0 0 0
EDGE2 0 2 2 0 1 1 0 1 4 0 0
""",
    ),
}
TAGS = ["FIX", "EQUIV", *G2O_TAGS, *TORO_TAGS, *GTSAM_TAGS]
WORDS = [
    "nan", "inf", "-inf", "0", "-0", "1", "-1", "1e30", "1e31", "1e-30", "1e308", "1e-320", "1e400",
    "0.5", "3.141592653589793", "-7", "100000", "1e9", "9223372036854775807", "9223372036854775808",
    "-9223372036854775809", "x", "1_0", "+5", "\u0663", "\u00b2", "1.5", "#",
]  # fmt: skip


def solve(data: bytes) -> None:
    """Optimise a file: refused with a sentence, or nothing fixed has moved and all is finite."""
    chance = random.Random(zlib.crc32(data))
    solver, init = chance.choice(list(SOLVERS)), chance.choice(list(STARTS))
    robust = "" if chance.random() < 0.5 or solver == "ekf" else chance.choice(list(KERNELS))
    if robust and solver in IN_ORDER:
        robust = CONSISTENT
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        path = Path(folder, "graph")
        path.write_bytes(data)
        clip = chance.random() < 0.5
        try:
            result = optimise(OptimiseOptions(path, solver, robust, init, clip_indefinite=clip))
        except RobotctlError:
            return
        for kind, rows in result.graph.rows(result.file.fixed).items():
            found, given = result.solution.values[kind][rows], result.file.values[kind][rows]
            assert np.array_equal(found, given), "a fixed variable has moved"
        assert all(np.all(np.isfinite(each)) for each in result.solution.values.values())
        json.dumps(result.report(), allow_nan=False)
        _write_and_read(result, Path(folder))


def _write_and_read(result, folder: Path) -> None:
    """Write the optimum in each format; what was written must be read again."""
    for each in (G2O, TORO, GTSAM):
        path = folder / f"optimum{each.suffix}"
        try:
            write_graph(result, path)
        except RobotctlError:
            continue
        assert read_graph(path).graph.size > 0


def mutate(data: bytes, most: int, seed: int) -> bytes:
    """Return an input that is changed as a graph, a few words or lines at a time."""
    chance = random.Random(seed)
    lines = data.decode("utf-8", "replace").split("\n")
    for _ in range(chance.randint(1, 4)):
        chance.choice(CHANGES)(lines, chance)
    text = "\n".join(lines).encode()[:most]
    if chance.random() < 0.03:
        packed = gzip.compress(text, 1)
        return packed[: chance.randint(1, len(packed))][:most]
    return text


def _word(
    lines: list[str], chance: random.Random, change: Callable[[list[str], int], None]
) -> None:
    """Change a word of a line."""
    at = chance.randrange(len(lines))
    words = lines[at].split(" ")
    change(words, chance.randrange(len(words)))
    lines[at] = " ".join(words)


def _put_odd_word(lines: list[str], chance: random.Random) -> None:
    _word(lines, chance, lambda words, at: words.__setitem__(at, chance.choice(WORDS)))


def _put_odd_character(lines: list[str], chance: random.Random) -> None:
    at = chance.randrange(len(lines))
    place = chance.randint(0, len(lines[at]))
    lines[at] = lines[at][:place] + chance.choice("\0\t\r -.e9\ufeff") + lines[at][place:]


def _put_tag(lines: list[str], chance: random.Random) -> None:
    _word(lines, chance, lambda words, _: words.__setitem__(0, chance.choice(TAGS)))


def _put_word_of_another_line(lines: list[str], chance: random.Random) -> None:
    other = chance.choice(lines).split(" ")
    _word(lines, chance, lambda words, at: words.__setitem__(at, chance.choice(other)))


def _drop_or_repeat_word(lines: list[str], chance: random.Random) -> None:
    times = chance.choice((0, 2))
    _word(lines, chance, lambda words, at: words.__setitem__(slice(at, at + 1), words[at : at + 1] * times))  # fmt: skip # noqa: E501


def _scale(lines: list[str], chance: random.Random) -> None:
    def change(words: list[str], at: int) -> None:
        try:
            words[at] = repr(float(words[at]) * chance.choice((-1.0, 1e-6, 1e6, 1e15, 1.01)))
        except ValueError:
            words[at] = "7"

    _word(lines, chance, change)


def _drop_line(lines: list[str], chance: random.Random) -> None:
    if len(lines) > 1:
        del lines[chance.randrange(len(lines))]


def _add_line(lines: list[str], chance: random.Random) -> None:
    seeds = [line for each in SEEDS.values() for text in each for line in text.splitlines()]
    lines.insert(chance.randrange(len(lines) + 1), chance.choice(chance.choice((lines, seeds))))


def _fix_or_merge(lines: list[str], chance: random.Random) -> None:
    ids = [words[1] for line in lines if len(words := line.split(" ")) > 1] or ["0"]
    chosen = " ".join(chance.choice(ids) for _ in range(chance.randint(1, 3)))
    lines.append(f"{chance.choice(('FIX', 'EQUIV'))} {chosen}")


CHANGES = (
    _put_odd_word, _put_odd_character, _put_tag, _put_word_of_another_line, _drop_or_repeat_word,
    _scale, _drop_line, _add_line, _fix_or_merge,
)  # fmt: skip
TARGETS = dict.fromkeys(SEEDS, solve)


def corpus(target: str) -> list[bytes]:
    """Return the seeds of a target, and the inputs kept for it."""
    kept = CORPUS / f"{target}.txt"
    lines = kept.read_text(encoding="ascii").splitlines() if kept.is_file() else []
    return [*(text.encode() for text in SEEDS[target]), *map(bytes.fromhex, lines)]
