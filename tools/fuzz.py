"""Look for input that upsets the MAVLink parser and services, graphs, or the readers of files.

It is led by the code that inputs reach. It needs atheris (https://github.com/google/atheris), which
is no part of the project's own set-up: `.cache/bootstrap/bin/uv pip install atheris`. An input that
fails is written to a file, whose name the last lines say. What reaches new code joins the corpus of
its target, which every run of the tests repeats.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import os
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))
os.environ["MAVLINK20"] = "1"

FAMILIES = {
    "tests.mavlink.fuzzing": ("robotctl.mavlink", "robotctl.drivers.mavlink"),
    "tests.logs.graphs.fuzzing": ("robotctl.logs.graphs", "robotctl.workbench.graphs"),
    "tests.files.fuzzing": (
        "robotctl.logs",
        "robotctl.maps",
        "robotctl.toml_source",
        "robotctl.config",
        "robotctl.app.processes.navigator",
        "firmware_sim.world",
    ),
}
"""Modules with targets, and the packages whose code leads the search.

A module has `TARGETS`, `corpus`, `CORPUS` and `LONGEST`; a `mutate` changes inputs by own rules.
"""

INSIDE = "ROBOTCTL_FUZZ_TARGET"
LIMITS = ("-timeout=30", "-rss_limit_mb=2048", "-len_control=0")
"""An input that takes longer [s] or more memory [MB] fails."""


def family_of(target: str) -> tuple[str, Any]:
    """Return the name of the module that has a target, and the module."""
    for name in FAMILIES:
        module = importlib.import_module(name)
        if target in module.TARGETS:
            return name, module
    raise SystemExit(f"no target {target}")


def fuzz_forever(name: str, target: str) -> None:
    """Try inputs, as the arguments of libFuzzer say; does not return."""
    import atheris  # noqa: PLC0415 - not installed everywhere

    # atheris tells packages apart by their first word only, and all of ours takes minutes: what is
    # imported before stays as it is.
    importlib.import_module(name)
    for each in [*sys.modules]:
        if each == name or any(f"{each}.".startswith(f"{led}.") for led in FAMILIES[name]):
            del sys.modules[each]
            package, _, name_there = each.rpartition(".")
            if package in sys.modules:  # or `from package import` would still find it
                vars(sys.modules[package]).pop(name_there, None)
    with atheris.instrument_imports(include=["robotctl", "firmware_sim"]):
        module = importlib.import_module(name)
    warnings.simplefilter("error")  # as in the tests
    own = {"custom_mutator": module.mutate} if hasattr(module, "mutate") else {}
    atheris.Setup(sys.argv, module.TARGETS[target], **own)
    atheris.Fuzz()


def main() -> int:
    """Run the command; 1 if an input failed."""
    targets = [each for name in FAMILIES for each in importlib.import_module(name).TARGETS]
    parser = argparse.ArgumentParser(prog="tools/fuzz.py", description=__doc__)
    parser.add_argument("target", choices=targets)
    parser.add_argument("--seconds", type=int, default=300, help="how long (%(default)s)")
    options = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        parser.error("atheris is missing; .cache/bootstrap/bin/uv pip install atheris")
    name, module = family_of(options.target)
    kept = module.CORPUS / f"{options.target}.txt"
    with tempfile.TemporaryDirectory() as folder:
        for index, data in enumerate(module.corpus(options.target)):
            Path(folder, str(index)).write_bytes(data)
        tried = subprocess.run(  # libFuzzer adds to the folder what reaches new code
            [
                sys.executable, __file__, f"-max_total_time={options.seconds}",
                f"-max_len={module.LONGEST}", *LIMITS, folder,
            ],
            env=os.environ | {INSIDE: f"{name} {options.target}"},
            check=False,
        )  # fmt: skip
        inputs = {each.read_bytes() for each in Path(folder).iterdir()}
    lines = sorted((each.hex() for each in inputs), key=lambda line: (len(line), line))
    kept.write_text("".join(f"{line}\n" for line in lines), encoding="ascii")
    print(f"{len(lines)} inputs in {kept.relative_to(ROOT)}")
    return int(tried.returncode != 0)


if __name__ == "__main__":
    if inside := os.environ.get(INSIDE):
        fuzz_forever(*inside.split())
    sys.exit(main())
