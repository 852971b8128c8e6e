"""What each package names as public, in its docstring, is there."""

import importlib
import re
from pathlib import Path

import pytest

import robotctl

PACKAGES = sorted(path.parent.name for path in Path(robotctl.__file__).parent.glob("*/__init__.py"))
HEADING = "\n\nPublic names:\n\n"
MOST_LINES = 16


def named(package):
    """Return the full names that the docstring of a package lists."""
    doc = importlib.import_module(f"robotctl.{package}").__doc__
    assert HEADING in doc, f"robotctl.{package}: its docstring has no list of public names"
    names = re.findall(r"`([\w.]+)`[,:]", doc.partition(HEADING)[2])
    return [f"robotctl.{package}.{name}" for name in names]


@pytest.mark.parametrize("package", PACKAGES)
def test_the_public_names_of_a_package_are_there_and_documented(package):
    names = named(package)
    assert names
    assert len(names) == len(set(names))
    for name in names:
        module, _, attribute = name.rpartition(".")
        public = getattr(importlib.import_module(module), attribute)
        assert public.__doc__
        assert not attribute.startswith("_")


@pytest.mark.parametrize("package", PACKAGES)
def test_the_list_is_short(package):
    doc = importlib.import_module(f"robotctl.{package}").__doc__
    assert len(doc.splitlines()) <= MOST_LINES


def test_all_in_backticks_is_a_name_that_is_tried():
    assert len(PACKAGES) > 15
    for package in PACKAGES:
        doc = importlib.import_module(f"robotctl.{package}").__doc__
        assert len(named(package)) == doc.partition(HEADING)[2].count("`") // 2
