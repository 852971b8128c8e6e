"""Say exactly what to install where this Python cannot set up the project.

Runs on any Python from 3.6, so that an old one can say that it is too old.
"""

import importlib.util
import shutil
import sys
from typing import Tuple  # noqa: UP035 - see above

NEEDED = (3, 11)


def problem(version: Tuple[int, int], has_venv: bool, has_apt: bool) -> str:  # noqa: UP006
    """Return what is missing and how to get it, or an empty string."""
    found = f"{version[0]}.{version[1]}"
    if version < NEEDED:
        return (
            f"robotctl needs Python 3.11 or newer; {sys.executable} is {found}. Install a newer "
            "one (Debian 12, Ubuntu 24.04 and later: apt-get install python3 python3-venv) and "
            "name it where it is not `python3`: make PYTHON=python3.12 ..."
        )
    if not has_venv:
        package = f"apt-get install python{found}-venv" if has_apt else "its module ensurepip"
        return f"{sys.executable} cannot make virtual environments; install as root: {package}"
    return ""


def main() -> None:
    """Exit with the problem, or with 0."""
    # Debian splits off ensurepip; the module venv alone is there without it.
    has_venv = all(importlib.util.find_spec(name) for name in ("venv", "ensurepip"))
    version = (sys.version_info[0], sys.version_info[1])
    sys.exit(problem(version, has_venv, shutil.which("apt-get") is not None) or 0)


if __name__ == "__main__":
    main()
