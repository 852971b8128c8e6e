"""Calls a compiled function in a new process for each line of standard input, and prints what came.

The processes are forks of this one, in which numba has compiled something: the next function takes
a tenth of a second instead of seconds.
"""

import importlib
import json
import os
import resource
import sys
import tempfile

import numba


@numba.njit(error_model="numpy")
def double(x: float) -> float:
    return 2.0 * x


def call(
    installed: str, package: str, environment: dict[str, str], temporary: str, full: bool
) -> tuple[float, int, str]:
    """Call the function with 3; return what came, how often the cache had it, and where that is."""
    os.environ.clear()
    os.environ.update(environment)
    tempfile.tempdir = temporary
    numba.config.reload_config()
    if full:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
    sys.path.insert(0, installed)
    sys.dont_write_bytecode = True
    half = importlib.import_module(f"{package}.kernel").half
    result = half(3.0)
    return result, sum(half.stats.cache_hits.values()), str(half.stats.cache_path)


if __name__ == "__main__":
    assert double(1.5) == 3.0
    for line in sys.stdin:
        if child := os.fork():
            _, status = os.waitpid(child, 0)
            sys.stdout.write("null\n" if status else "\n")
        else:
            sys.stdout.write(json.dumps(call(**json.loads(line))))
            sys.stdout.flush()
            os._exit(0)
        sys.stdout.flush()
