"""Once imported, numba has compiled something: the next function takes it a tenth of a second."""

import numba


@numba.njit(error_model="numpy")
def _double(x: float) -> float:
    return 2.0 * x


assert _double(1.5) == 3.0
