"""Look for input that upsets the MAVLink parser or its services, led by the code that it reaches.

Needs atheris (https://github.com/google/atheris), which is no part of the project's own set-up:
`.cache/bootstrap/bin/uv pip install atheris`. An input that fails is written to a file, whose name
the last lines say. What reaches new code joins the corpus in tests/mavlink/corpus, which every run
of the tests repeats.
"""

from __future__ import annotations

import argparse
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
LONGEST = "-max_len=1024"


def fuzz_forever(target: str) -> None:
    """Try inputs, as the arguments of libFuzzer say; does not return."""
    import atheris  # noqa: PLC0415 - not installed everywhere

    with atheris.instrument_imports(include=["robotctl.mavlink", "robotctl.drivers.mavlink"]):
        from tests.mavlink.fuzzing import TARGETS  # noqa: PLC0415 - instrumented

    atheris.Setup(sys.argv, TARGETS[target])
    atheris.Fuzz()


def main() -> int:
    """Run the command; 1 if an input failed."""
    parser = argparse.ArgumentParser(prog="tools/fuzz.py", description=__doc__)
    parser.add_argument("target", choices=("parser", "services"))
    parser.add_argument("--seconds", type=int, default=300, help="how long (%(default)s)")
    options = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        parser.error("atheris is missing; .cache/bootstrap/bin/uv pip install atheris")
    from tests.mavlink.fuzzing import CORPUS, corpus  # noqa: PLC0415 - see above

    kept = CORPUS / f"{options.target}.txt"
    with tempfile.TemporaryDirectory() as folder:
        for index, data in enumerate(corpus(options.target)):
            Path(folder, str(index)).write_bytes(data)
        tried = subprocess.run(  # libFuzzer adds to the folder what reaches new code
            [sys.executable, __file__, f"-max_total_time={options.seconds}", LONGEST, folder],
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
