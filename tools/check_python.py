"""Say exactly what to install where this Python cannot set up the project.

Must run on any Python 3, old ones too: no modern syntax.
"""

import shutil
import sys

NEEDED = (3, 11)


def problem(version, has_venv, has_apt):  # noqa: ANN001, ANN201 - runs on Pythons without annotations
    """Return what is missing and how to get it, or an empty string."""
    found = ".".join(str(part) for part in version[:2])
    if tuple(version[:2]) < NEEDED:
        return (
            "robotctl needs Python 3.11 or newer; python3 is %s (%s). Install a newer one "
            "(Debian 12, Ubuntu 24.04 and later: apt-get install python3 python3-venv) and name "
            "it: make PYTHON=python3.11 ..." % (found, sys.executable)  # noqa: UP031
        )
    if not has_venv:
        package = "python%s-venv" % found  # noqa: UP031
        if has_apt:
            return "this Python has no venv. Run as root: apt-get install " + package
        return "this Python has no venv: install the package with its modules venv and ensurepip"
    return ""


def main():  # noqa: ANN201
    """Exit with the problem, or with 0."""
    try:
        import ensurepip  # noqa: F401, PLC0415 - Debian splits it off
        import venv  # noqa: F401, PLC0415

        has_venv = True
    except ImportError:
        has_venv = False
    sys.exit(problem(sys.version_info, has_venv, shutil.which("apt-get") is not None) or 0)


if __name__ == "__main__":
    main()
