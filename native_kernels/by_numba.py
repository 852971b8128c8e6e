"""Kernels by numba: compiled at their first call, cached in the folder of their package."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from numba.core import caching, types
from numba.extending import typeof_impl

from native_kernels.cache import alone, cache_of, package_of
from native_kernels.library import LOADED

_FUNCTION_CACHE: Any = caching.FunctionCache
_RESULTS: Any = caching.CompileResultCacheImpl
_LOCATOR: Any = caching._CacheLocator
_SOURCE_FILE: Any = caching._SourceFileBackedLocatorMixin
_TUPLE: Any = types.BaseTuple
_TYPE_OF: Any = typeof_impl


class _Locator(_SOURCE_FILE, _LOCATOR):  # type: ignore[misc] # numba has no types
    """Place of the code of a function, by its module, and by the digest of what it is made of."""

    def __init__(self, function: Any, file: str) -> None:
        self._py_file, self._lineno = file, function.__code__.co_firstlineno
        kept = cache_of(package_of(function))
        self._folder = str(Path(kept.folder, function.__module__))
        name = function.__qualname__.partition(".")[0]
        self._digest = kept.digests.get(f"{function.__module__}:{name}")

    @classmethod
    def from_function(cls, function: Any, file: str) -> _Locator:
        """Return where it is kept; the folder is made when there is something to keep."""
        return cls(function, file)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return self._folder

    def get_source_stamp(self) -> Any:
        """Return the digest; time and size of the file for a function outside the package."""
        return self._digest or super().get_source_stamp()

    def get_disambiguator(self) -> Any:
        """Return the digest, where there is one, for the names of files."""
        return self._digest or super().get_disambiguator()


class _Files(_RESULTS):  # type: ignore[misc]
    """The files of a function's code."""

    _locator_classes = (_Locator,)


class _Cache(_FUNCTION_CACHE):  # type: ignore[misc]
    """Compiled code of one function; a file that is cut or a full disk only costs time."""

    _impl_class = _Files

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function of a signature; None if there is none, or none whole."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001 - whatever pickle makes of a file that lost its end
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function, if the disk takes it."""
        with suppress(OSError), alone(Path(cache_of(package_of(self._py_func)).folder)):
            super().save_overload(sig, data)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return what names one version: named tuples with their fields, which numba leaves out."""
        return (*super()._index_key(sig, codegen), *(_fields(each) for each in sig))


def _fields(kind: Any) -> Any:
    """Return the fields of a named tuple's type, and of those within."""
    if isinstance(kind, _TUPLE):
        return (getattr(kind, "fields", ()), *(_fields(each) for each in kind.types))
    return ()


def dispatcher_of(function: Any) -> Any:
    """Return what compiles a function at its first call; division by zero gives inf or nan."""
    for library in LOADED:  # it may call their kernels
        _TYPE_OF.register(library.Kernel)(_type_of)
    jit: Any = numba.njit
    how = {"forceinline": True, "_nrt": False} if hasattr(function, "borrows") else {}
    dispatcher: Any = jit(error_model="numpy", **how)(function)
    if cache_of(package_of(function)).folder:
        dispatcher._cache = _Cache(function)  # as its `enable_caching` does
    return dispatcher


def _type_of(kernel: Any, _: Any) -> Any:
    """Return the type of a native kernel for numba, which compiles what calls it."""
    return types.Dispatcher(kernel.dispatcher)
