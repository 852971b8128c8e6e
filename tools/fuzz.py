"""Look for input that upsets what reads from outside, led by the code that it reaches.

Needs atheris (https://github.com/google/atheris), which is no part of the project's own set-up:
`.cache/bootstrap/bin/uv pip install atheris`. An input that fails is written to a file, whose name
the last lines say. What reaches new code joins the corpus beside the target's tests, which repeat
all of it.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))
os.environ["MAVLINK20"] = "1"

INSIDE = "ROBOTCTL_FUZZ_TARGET"
MAVLINK, GRAPHS = "tests.mavlink.fuzzing", "tests.logs.graphs.fuzzing"
TARGETS = {
    "parser": MAVLINK,
    "services": MAVLINK,
    "g2o": GRAPHS,
    "toro": GRAPHS,
    "gtsam": GRAPHS,
}
"""The module of each target. It has `TARGETS`, `corpus` and `CORPUS`; `LONGEST` and `mutate` change
inputs by rules of their own."""
LONGEST = 1024


def fuzz_forever(target: str) -> None:
    """Try inputs, as the arguments of libFuzzer say; does not return."""
    import atheris  # noqa: PLC0415 - not installed everywhere

    # What is instrumented cannot be compiled.
    files = {path: path.relative_to(ROOT) for path in (ROOT / "robotctl").rglob("*.py")}
    compiled = [
        ".".join(name.with_suffix("").parts)
        for path, name in files.items()
        if b"@compiled" in path.read_bytes()
    ]
    with atheris.instrument_imports(include=["robotctl"], exclude=compiled):
        module = importlib.import_module(TARGETS[target])
    own = {"custom_mutator": module.mutate} if hasattr(module, "mutate") else {}
    atheris.Setup(sys.argv, module.TARGETS[target], **own)
    atheris.Fuzz()


def main() -> int:
    """Run the command; 1 if an input failed."""
    parser = argparse.ArgumentParser(prog="tools/fuzz.py", description=__doc__)
    parser.add_argument("target", choices=tuple(TARGETS))
    parser.add_argument("--seconds", type=int, default=300, help="how long (%(default)s)")
    options = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        parser.error("atheris is missing; .cache/bootstrap/bin/uv pip install atheris")
    module = importlib.import_module(TARGETS[options.target])
    kept = module.CORPUS / f"{options.target}.txt"
    longest = f"-max_len={getattr(module, 'LONGEST', LONGEST)}"
    with tempfile.TemporaryDirectory() as folder:
        for index, data in enumerate(module.corpus(options.target)):
            Path(folder, str(index)).write_bytes(data)
        tried = subprocess.run(  # libFuzzer adds to the folder what reaches new code
            [sys.executable, __file__, f"-max_total_time={options.seconds}", longest, folder],
            env=os.environ | {INSIDE: options.target},
            check=False,
        )
        inputs = {each.read_bytes() for each in Path(folder).iterdir()}
    lines = sorted((each.hex() for each in inputs), key=lambda line: (len(line), line))
    kept.write_text("".join(f"{line}\n" for line in lines), encoding="ascii")
    print(f"{len(lines)} inputs in {kept.relative_to(ROOT)}")
    return int(tried.returncode != 0)


if __name__ == "__main__":
    if target := os.environ.get(INSIDE):
        fuzz_forever(target)
    sys.exit(main())
