"""Identity of a controller: a hash over its code, over what the code uses, and over its numbers."""

from __future__ import annotations

import hashlib
import sys
import types
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np


def identity_of(controller: Any) -> str:
    """Return the name of a controller's class, and a hash over all that decides what it commands.

    That is the code of its classes, the functions, classes and numbers that the code names, as far as they are not of
    an installed library, the libraries' versions, and the numbers and texts of the object itself.
    """
    kind = type(controller)
    walk = _Walk()
    walk.value(kind)
    walk.mapping(vars(controller), skip=("adaptation", "telemetry"))
    return f"{kind.__module__}.{kind.__qualname__} {walk.hash.hexdigest()[:32]}"


def numbers_of(controller: Any) -> str:
    """Return a hash over the class, the numbers and the texts of a controller's object."""
    walk = _Walk()
    walk.text(type(controller).__module__, type(controller).__qualname__)
    walk.mapping(vars(controller), skip=("adaptation", "telemetry"))
    return walk.hash.hexdigest()


class _Walk:
    def __init__(self) -> None:
        self.hash = hashlib.sha256()
        self._seen: set[int] = set()
        self._kept: list[Any] = []  # so that no number of an object is given to another one

    def text(self, *texts: object) -> None:
        for text in texts:
            encoded = str(text).encode(errors="replace")
            self.hash.update(len(encoded).to_bytes(8, "little") + encoded)

    def mapping(self, values: Mapping[str, Any], skip: Iterable[str] = ()) -> None:
        for name in sorted(values):
            if name not in skip:
                self.text(name)
                self.value(values[name])

    def value(self, value: Any) -> None:
        if isinstance(value, bool | int | float | complex | str | bytes | type(None)):
            self.text(type(value).__name__, repr(value))
        elif isinstance(value, np.ndarray | np.generic):
            self.text(value.dtype.str, np.shape(value))
            self.hash.update(np.ascontiguousarray(value).tobytes())
        elif isinstance(value, tuple | list):
            self.text(type(value).__name__, len(value))
            for item in value:
                self.value(item)
        elif isinstance(value, dict):
            self.text("dict", len(value))
            self.mapping({repr(key): item for key, item in value.items()})
        elif id(value) not in self._seen:
            self._seen.add(id(value))
            self._kept.append(value)
            self.object(value)

    def object(self, value: Any) -> None:
        if isinstance(value, staticmethod | classmethod | types.MethodType):
            self.value(value.__func__)
        elif isinstance(value, property):
            self.value([value.fget, value.fset])
        elif isinstance(value, types.FunctionType):
            self.function(value)
        elif isinstance(value, types.CodeType):
            self.code(value)
        elif isinstance(value, types.ModuleType):
            self.text(value.__name__, getattr(value, "__version__", ""))
        elif isinstance(value, type):
            self.kind(value)
        else:
            # The rest is known by its type only, such as a solver of a library.
            self.text(type(value).__module__, type(value).__qualname__)

    def kind(self, kind: type) -> None:
        for base in kind.__mro__:
            self.text(base.__module__, base.__qualname__)
            if not _is_installed(base.__module__):
                members = {name: value for name, value in vars(base).items() if not _is_of_interpreter(name, value)}
                self.mapping(members)

    def function(self, function: types.FunctionType) -> None:
        self.text(function.__module__, function.__qualname__)
        if _is_installed(function.__module__):
            return
        self.value(function.__code__)
        self.value([function.__defaults__, list((function.__kwdefaults__ or {}).items())])
        for cell in function.__closure__ or ():
            try:
                self.value(cell.cell_contents)
            except ValueError:
                self.text("empty")
        for name in sorted(_names(function.__code__)):
            if name in function.__globals__:
                self.text(name)
                self.value(function.__globals__[name])

    def code(self, code: types.CodeType) -> None:
        self.text(code.co_name, code.co_names, code.co_varnames)
        self.hash.update(code.co_code)
        for constant in code.co_consts:
            self.value(constant)


def _names(code: types.CodeType) -> set[str]:
    inner = (_names(constant) for constant in code.co_consts if isinstance(constant, types.CodeType))
    return set(code.co_names).union(*inner)


def _is_installed(module: str) -> bool:
    """Return whether a module is of the interpreter, or of an installed package, whose version stands for its code."""
    root = module.partition(".")[0]
    if root in ("builtins", "gerono") or root in sys.stdlib_module_names:
        return True
    file = getattr(sys.modules.get(root), "__file__", None) or ""
    return "site-packages" in file or "dist-packages" in file


def _is_of_interpreter(name: str, value: Any) -> bool:
    """Return whether a member is a note of the interpreter, some of which come and go, and no method such as `__init__`."""
    return name.startswith("__") and not isinstance(value, types.FunctionType)
