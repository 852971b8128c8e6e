"""What a package exports can be imported from it, is documented, and costs nothing until used."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import robotctl

ROOT = Path(robotctl.__file__).parent
PACKAGES = sorted(
    ".".join(path.parent.relative_to(ROOT).parts) for path in ROOT.rglob("__init__.pyi")
)
MOST_NAMES = 20


def folder(package):
    return ROOT.joinpath(*package.split("."))


def listed(package):
    """Return (module, name) for each name of the stub that lists a package's exports."""
    tree = ast.parse((folder(package) / "__init__.pyi").read_text())
    return [
        (f"robotctl.{package}.{statement.module}", alias.name)
        for statement in tree.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    ]


def test_the_packages_that_a_program_builds_on_export_names():
    assert {"model", "control", "estimation", "planning", "drivers", "logs", "maps"} <= set(
        PACKAGES
    )


@pytest.mark.parametrize("package", PACKAGES)
def test_an_exported_name_is_the_one_of_its_module_and_documented(package):
    names = listed(package)
    assert 0 < len(names) <= MOST_NAMES
    exporting = importlib.import_module(f"robotctl.{package}")
    assert sorted(name for _, name in names) == sorted(exporting.__all__)
    for module, name in names:
        public = getattr(exporting, name)
        assert public is getattr(importlib.import_module(module), name)
        assert public.__doc__


@pytest.mark.parametrize("package", PACKAGES)
def test_no_exported_name_hides_a_module(package):
    modules = {path.stem for path in folder(package).iterdir()}
    assert not modules & {name for _, name in listed(package)}


def test_importing_a_package_loads_none_of_its_modules():
    program = """
import sys
import robotctl.estimation, robotctl.planning
loaded = [name for name in sys.modules if name.count(".") > 1 and name.startswith("robotctl.")]
assert not loaded, loaded
assert not {"numpy", "numba", "cv2"} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", program], check=True)
