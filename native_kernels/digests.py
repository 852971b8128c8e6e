"""Digests of the kernels: of all that machine code is made of, and of nothing else.

The digest of a kernel covers its definition and every definition of the package that it names,
wherever that is: kernels that it calls, constants with what they are computed from, and the classes
in its annotations; and how all are compiled. Words do not count: comments, docstrings, lines and
blanks.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final, TypeAlias

_DECORATOR: Final = "compiled"
_HOW: Final = "dispatcher_of"
"""Name of what compiles a kernel."""
_ALL: Final = "*"
"""Stands for all names of a module."""
_DIGITS: Final = 16

Name: TypeAlias = tuple[str, str]
"""Module, and a name at its top."""


@dataclass(frozen=True)
class _Definition:
    """Digest of what gives a name its value, and the names that are read for it."""

    digest: bytes
    reads: frozenset[str]


@dataclass(frozen=True)
class _Module:
    """Definitions at the top of a module, and its imports from its package."""

    tree: ast.Module
    package: str

    @cached_property
    def definitions(self) -> dict[str, list[_Definition]]:
        """Definitions by name: several, where the value is changed after the first."""
        found: dict[str, list[_Definition]] = {}
        for statement in _without_words(self.tree.body):
            definition = _definition(statement)
            for name in {_ALL, *_defined(statement)}:
                found.setdefault(name, []).append(definition)
        return found

    @cached_property
    def imports(self) -> dict[str, set[Name]]:
        """Sources of the names that are imported from the package, anywhere in the module."""
        found: dict[str, set[Name]] = {}
        for node in ast.walk(self.tree):
            match node:
                case ast.ImportFrom(module=str(module)):
                    sources = [(each, (module, each.name)) for each in node.names]
                case ast.Import():
                    sources = [(each, (each.name, _ALL)) for each in node.names]
                case _:
                    continue
            for alias, source in sources:
                if f"{source[0]}.".startswith(f"{self.package}."):
                    (name,) = _named(alias)
                    found.setdefault(name, set()).add(source)
        return found

    @cached_property
    def kernels(self) -> set[str]:
        """Names at the top of functions that are compiled, or in which one is."""
        return {
            name
            for each in self.tree.body
            if any(map(_is_kernel, ast.walk(each)))
            for name in _defined(each)
        }


@dataclass(frozen=True)
class KernelDigests:
    """Digests of the kernels in a package, from its sources by path, and that of the compiler."""

    package: Path
    sources: dict[Path, bytes]
    compiler: bytes
    _modules: dict[str, _Module] = field(default_factory=dict, repr=False)

    def all(self) -> dict[str, str]:
        """Return the digest of each kernel, by its module, a colon, and its name there."""
        return {
            f"{module}:{name}": self._digest(self.definitions_of((module, name)))
            for path, text in self.sources.items()
            if b"@compiled" in text
            for module in [self._name_of(path)]
            for name in sorted(self._module(module).kernels)
        }

    def definitions_of(self, kernel: Name) -> dict[Name, list[_Definition]]:
        """Return the definitions that a kernel is made of, its own among them."""
        found: dict[Name, list[_Definition]] = {}
        new = [kernel]
        while new:
            place = module_name, name = new.pop()
            if place in found:
                continue
            found[place] = []
            module = self._module(module_name)
            if name in module.imports:
                new += [each for source in module.imports[name] for each in self._resolved(source)]
            if name in module.definitions:
                found[place] = module.definitions[name]
                new += [(module_name, each) for own in found[place] for each in own.reads]
        return {place: each for place, each in found.items() if each}

    @cached_property
    def _how(self) -> bytes:
        """Digest of how kernels are compiled."""
        (how,) = _Module(ast.parse(self.compiler), self.package.name).definitions[_HOW]
        return how.digest

    def _resolved(self, source: Name) -> Iterator[Name]:
        """Yield where an imported name is to be looked up: all of a module where it is one."""
        module, name = source
        if self._path_of(inner := f"{module}.{name}"):
            yield inner, _ALL
        elif self._path_of(module):
            known = self._module(module)
            is_known = name in known.definitions or name in known.imports
            yield module, name if is_known else _ALL

    def _module(self, name: str) -> _Module:
        if name not in self._modules:
            path = self._path_of(name)
            tree = ast.parse(self.sources[path] if path else b"")
            self._modules[name] = _Module(tree, self.package.name)
        return self._modules[name]

    def _path_of(self, module: str) -> Path | None:
        """Return the file of a module, None if there is none."""
        folder = self.package.joinpath(*module.split(".")[1:])
        paths = (folder.with_suffix(".py"), folder / "__init__.py")
        return next((path for path in paths if path in self.sources), None)

    def _name_of(self, path: Path) -> str:
        parts = path.relative_to(self.package).with_suffix("").parts
        return ".".join((self.package.name, *parts))

    def _digest(self, definitions: dict[Name, list[_Definition]]) -> str:
        digest = hashlib.sha256(self._how)
        for (module, name), each in sorted(definitions.items()):
            digest.update(f"{module}:{name}:{len(each)}".encode())
            digest.update(b"".join(one.digest for one in each))
        return digest.hexdigest()[:_DIGITS]


def _definition(statement: ast.stmt) -> _Definition:
    """Return what a statement says, without its words."""
    for node in ast.walk(statement):
        if isinstance(body := getattr(node, "body", None), list):
            node.body = [*_without_words(body)]  # type: ignore[attr-defined]
    reads = frozenset(node.id for node in ast.walk(statement) if isinstance(node, ast.Name))
    return _Definition(hashlib.sha256(ast.dump(statement).encode()).digest(), reads)


def _without_words(body: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """Yield statements but those that are text: docstrings."""
    for each in body:
        is_expression = isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant)
        if not (is_expression and isinstance(each.value.value, str)):  # type: ignore[attr-defined]
            yield each


def _defined(statement: ast.stmt) -> set[str]:
    """Return the names that a statement at the top of a module may give a value, or change."""
    match statement:
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            return {name}
        case ast.Assign(targets=targets):
            parts: list[ast.expr | ast.stmt] = [*targets]
        case ast.AnnAssign(target=target):
            parts = [target]
        case _:  # a call may change all that it is given
            parts = [statement]
    return {name for part in parts for node in ast.walk(part) for name in _named(node)}


def _named(node: ast.AST) -> list[str]:
    """Return the name that a node is, defines, or imports."""
    match node:
        case ast.Name(id=name) | ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            return [name]
        case ast.alias(name=module, asname=name):
            return [name or module.partition(".")[0]]
        case _:
            return []


def _is_kernel(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef) and any(
        isinstance(each, ast.Name) and each.id == _DECORATOR for each in node.decorator_list
    )
