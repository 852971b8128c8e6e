"""The advice of the set-up where this Python cannot do it."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

PATH = Path(__file__).resolve().parents[2] / "tools" / "check_python.py"
spec = importlib.util.spec_from_file_location("check_python", PATH)
assert spec is not None
assert spec.loader is not None
check_python = importlib.util.module_from_spec(spec)
spec.loader.exec_module(check_python)


def test_an_old_python_is_told_what_to_install_and_how_to_name_it() -> None:
    advice = check_python.problem((3, 10), True, True)
    assert "needs Python 3.11" in advice
    assert f"{sys.executable} is 3.10" in advice
    assert "make PYTHON=" in advice


def test_debians_split_off_venv_is_named_by_its_package() -> None:
    assert check_python.problem((3, 13), False, True).endswith("apt-get install python3.13-venv")


def test_a_complete_python_has_no_problem() -> None:
    assert check_python.problem((3, 11), True, True) == ""
