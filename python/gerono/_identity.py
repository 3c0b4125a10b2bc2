"""Identity of a controller: a hash over its code, the objects that the code uses, and its numbers."""

from __future__ import annotations

import copyreg
import ctypes
import dis
import functools
import hashlib
import importlib.machinery
import importlib.metadata
import logging
import os
import sys
import threading
import types
from collections import ChainMap
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping
from pathlib import Path
from typing import Any

import numpy as np

from gerono.controller import FLIGHT_FIELDS


def identity_of(controller: Any) -> str:
    """Return the name of a controller's class, and a hash over everything on which its commands depend.

    That is the code of its classes; the functions, classes, objects and numbers that the code names, also in modules
    that are not installed libraries; the libraries' versions; and the content of the object itself. It is the same in
    every process. An object with unreadable content raises a TypeError.
    """
    kind = type(controller)
    walk = _Walk()
    parts = walk.numbers(controller), walk.of(kind), walk.module_members()
    return f"{kind.__module__}.{kind.__qualname__} {_joined(*parts).hex()[:32]}"


Shared = dict[int, tuple[Any, bytes]]


def numbers_of(controller: Any, shared: Shared | None = None) -> str:
    """Return a hash over the content of a controller's object, and over its class.

    Shared objects are left out, as flights may change them: variables of modules do not count, and classes and functions
    in `shared` count with their hash there.
    """
    walk = _Walk({} if shared is None else shared)
    return _joined(walk.numbers(controller), walk.of(type(controller))).hex()


# Types hashed by name and `repr`.
_PLAIN = (bool, int, float, complex, str, bytes, bytearray, type(None), type(...), type(NotImplemented), range)

# Functions and members of compiled modules.
_COMPILED = (
    types.BuiltinFunctionType,
    types.ClassMethodDescriptorType,
    types.GetSetDescriptorType,
    types.MemberDescriptorType,
    types.MethodDescriptorType,
    types.MethodWrapperType,
    types.WrapperDescriptorType,
)

# All functions that dispatch by type share its code.
_DISPATCHING: Any = functools.singledispatch(repr)

# Without effect on commands; cached properties have one.
_LOCKS = (type(threading.Lock()), type(threading.RLock()))


def _joined(*parts: object) -> bytes:
    """Return a hash over texts and hashes."""
    joined = hashlib.sha256()
    for part in parts:
        encoded = part if isinstance(part, bytes) else str(part).encode(errors="surrogatepass")
        joined.update(len(encoded).to_bytes(8, "little") + encoded)
    return joined.digest()


class _Walk:
    """Recursive hash of objects, which depends on their content and on no address.

    With `shared`, variables of modules are left out, and the hashes of classes and functions are taken from it.
    """

    def __init__(self, shared: Shared | None = None) -> None:
        self._shared = shared
        # Hashes by the `id` of the object, with a reference to it so that the `id` is not reused.
        self._known: MutableMapping[int, tuple[Any, bytes]] = {}
        self._open: list[int] = []
        self._path: list[str] = []
        self._modules: dict[str, types.ModuleType] = {}
        self._names: set[str] = set()

    def numbers(self, controller: Any) -> bytes:
        """Return a hash over the content of a controller's object."""
        self._path = [type(controller).__qualname__]
        self._open.append(id(controller))
        return self._named(vars(controller), skip=FLIGHT_FIELDS)

    def module_members(self) -> bytes:
        """Return a hash over the members that the code names in modules that are not libraries."""
        done: set[tuple[str, str]] = set()
        parts: list[object] = []
        # Members may name further members.
        while found := sorted({(module, name) for module in self._modules for name in self._names} - done):
            done.update(found)
            for module, name in found:
                if hasattr(self._modules[module], name):
                    self._path = [module, name]
                    parts += [module, name, self.of(getattr(self._modules[module], name))]
        return _joined(*parts)

    def of(self, value: Any) -> bytes:
        if type(value) in _PLAIN:
            return _joined(type(value).__name__, repr(value))
        number = id(value)
        if number in self._known:
            return self._known[number][1]
        shared = self._shared if isinstance(value, type | types.FunctionType) else None
        if shared is not None and number in shared:
            return shared[number][1]
        if number in self._open:
            return _joined("circle", len(self._open) - self._open.index(number))
        self._open.append(number)
        digest = self._content(value) if shared is None else self._isolated(self._content, value)
        self._open.pop()
        (self._known if shared is None else shared)[number] = value, digest
        return digest

    def _isolated(self, hashed: Callable[[Any], bytes], value: Any) -> bytes:
        """Hash a value without adding to the known hashes, so that the hashes of other values do not depend on it."""
        known = self._known
        self._known = ChainMap({}, known)
        digest = hashed(value)
        self._known = known
        return digest

    def _all_of(self, values: Iterable[Any]) -> bytes:
        return _joined(*map(self.of, values))

    def _named(self, values: Mapping[str, Any], skip: Iterable[str] = ()) -> bytes:
        parts: list[object] = []
        for name in sorted(values):
            if name not in skip:
                self._path.append(name)
                parts += [name, self.of(values[name])]
                self._path.pop()
        return _joined(*parts)

    def _unordered(self, values: Iterable[Any]) -> bytes:
        """Return a hash that does not depend on the order."""
        return _joined(*sorted(self._isolated(self.of, value) for value in values))

    def _content(self, value: Any) -> bytes:
        kind = type(value)
        if kind in (tuple, list):
            return _joined(kind.__name__, self._all_of(value))
        if kind in (set, frozenset):
            return _joined(kind.__name__, self._unordered(value))
        if kind in (dict, types.MappingProxyType):
            is_namespace = all(type(key) is str for key in value)
            return _joined("dict", self._named(value) if is_namespace else self._unordered(value.items()))
        if kind is np.ndarray or isinstance(value, np.generic):
            # Arrays of objects hold addresses, and structures have padding.
            has_memory = not value.dtype.hasobject and value.dtype.names is None
            content = np.ascontiguousarray(value).tobytes() if has_memory else self.of(value.tolist())
            return _joined(kind.__name__, repr(value.dtype), np.shape(value), content)
        if isinstance(value, types.ModuleType):
            return self._module(value)
        if isinstance(value, type):
            return self._kind(value)
        if isinstance(value, types.FunctionType):
            return self._function(value)
        if isinstance(value, types.CodeType):
            return self._code(value)
        if isinstance(value, logging.Logger):
            # Its handlers and levels have no effect on commands.
            return _joined("logger", value.name)
        if isinstance(value, types.MethodType | types.BuiltinMethodType) and _is_of_library(value):
            return _joined(type(value.__self__).__module__, value.__name__, _version(type(value.__self__).__module__))
        if isinstance(value, types.MethodType | staticmethod | classmethod):
            return _joined(kind.__name__, self._all_of([value.__func__, getattr(value, "__self__", None)]))
        if isinstance(value, property):
            return self._all_of([value.fget, value.fset, value.fdel])
        if isinstance(value, _COMPILED):
            return self._compiled(value)
        if kind in _LOCKS:
            return _joined("lock")
        return self._object(value)

    def _object(self, value: Any) -> bytes:
        kind = type(value)
        wrapped = getattr(value, "__wrapped__", None)
        if isinstance(wrapped, types.FunctionType) and _is_installed(kind.__module__):
            # A function that a library caches, compiles or dispatches.
            return _joined(kind.__module__, kind.__qualname__, self.of(wrapped))
        reduce = copyreg.dispatch_table.get(kind)
        try:
            if isinstance(value, ctypes.CDLL) or (isinstance(value, np.ufunc) and "(vectorized)" in value.__name__):
                raise TypeError("its code is not Python")
            reduced = reduce(value) if reduce else value.__reduce_ex__(2)
        except Exception as error:
            raise self._refusal(kind, str(error)) from error
        parts = (reduced,) if isinstance(reduced, str) else reduced
        lists = [list(part) if isinstance(part, Iterator) else part for part in parts]
        # `__getstate__` may leave out members.
        return _joined(self.of(kind), self.of(getattr(value, "__dict__", None)), self._all_of(lists))

    def _refusal(self, kind: type, reason: str) -> TypeError:
        return TypeError(
            f"{'.'.join(self._path)} is a {kind.__module__}.{kind.__qualname__}, whose content cannot be read ({reason}), so "
            "rows of a sweep could not be checked to be flown by this controller: use numbers, arrays and objects of your "
            "own classes, or define `__reduce__` in its class"
        )

    def _kind(self, kind: type) -> bytes:
        parts: list[object] = []
        for base in kind.__mro__:
            parts += [base.__module__, base.__qualname__]
            if _is_installed(base.__module__):
                parts.append(_version(base.__module__))
            else:
                members = {name: value for name, value in vars(base).items() if not _is_of_interpreter(name, value)}
                parts.append(self._named(members))
        return _joined(*parts)

    def _function(self, function: types.FunctionType) -> bytes:
        # `__module__` may be that of the wrapped function.
        module = str(function.__globals__.get("__name__"))
        self._path.append(function.__name__)
        parts: list[object] = [module, function.__qualname__]
        is_library = _is_installed(module)
        if function.__code__ is _DISPATCHING.__code__:
            # Its other members are caches.
            parts.append(self.of(vars(function)["registry"]))
        elif not is_library or function.__closure__:
            parts.append(self._all_of([function.__defaults__, function.__kwdefaults__, None if is_library else vars(function)]))
            for name, cell in zip(function.__code__.co_freevars, function.__closure__ or ()):
                try:
                    parts.append(self._named({name: cell.cell_contents}))
                except ValueError:
                    parts.append("empty")
        if is_library:
            parts.append(_version(module))
        else:
            parts.append(self.of(function.__code__))
            if self._shared is None:
                parts.append(self._named(_globals(function.__code__, function.__globals__)))
                parts.append(self._all_of(_imported(function.__code__, function.__globals__)))
        self._path.pop()
        return _joined(*parts)

    def _code(self, code: types.CodeType) -> bytes:
        self._names.update(code.co_names)
        texts = code.co_name, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
        return _joined(*texts, code.co_code, getattr(code, "co_exceptiontable", b""), self._all_of(code.co_consts))

    def _module(self, module: types.ModuleType) -> bytes:
        if _is_installed(module.__name__):
            return _joined(module.__name__, _version(module.__name__))
        self._modules[module.__name__] = module
        file = getattr(module, "__file__", None) or ""
        # Compiled modules have no Python code to hash.
        is_compiled = file.endswith(tuple(importlib.machinery.EXTENSION_SUFFIXES))
        return _joined(module.__name__, Path(file).read_bytes() if is_compiled else "")

    def _compiled(self, value: Any) -> bytes:
        owner = getattr(value, "__self__", None)
        module = str(getattr(value, "__module__", None) or getattr(getattr(value, "__objclass__", None), "__module__", ""))
        if not module and type(owner).__name__ == "PyCapsule":
            return _joined("gerono.math", value.__name__)
        own = None if _is_installed(module) else sys.modules.get(module)
        # The object of a method such as `generator.normal`; a function's owner is its module.
        bound = None if isinstance(owner, types.ModuleType) or type(owner).__name__ == "PyCapsule" else owner
        return _joined(module, value.__qualname__, _version(module), self._all_of([own, bound]))


def _instructions(code: types.CodeType) -> Iterator[list[dis.Instruction]]:
    """Yield the instructions of code, and those of each function in it."""
    yield list(dis.get_instructions(code))
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _instructions(constant)


def _globals(code: types.CodeType, names: Mapping[str, Any]) -> dict[str, Any]:
    """Return the module variables that code reads."""
    steps = (step for steps in _instructions(code) for step in steps)
    read = {step.argval for step in steps if "GLOBAL" in step.opname or step.opname == "LOAD_NAME"}
    return {name: names[name] for name in read & names.keys()}


def _imported(code: types.CodeType, names: Mapping[str, Any]) -> Iterator[types.ModuleType]:
    """Yield the modules that code imports when it runs; they are imported here."""
    for steps in _instructions(code):
        for level, items, step in zip(steps, steps[1:], steps[2:]):
            if step.opname == "IMPORT_NAME":
                try:
                    yield __import__(step.argval, names, None, items.argval, level.argval)
                except ImportError:
                    continue  # it would fail in the code as well


_LIBRARY = os.path.dirname(os.__file__) + os.sep


def _is_installed(module: str) -> bool:
    """Return whether a module belongs to the interpreter or an installed package, and is identified by its version."""
    root = module.partition(".")[0]
    if root in ("builtins", "gerono"):
        return True
    files = (getattr(sys.modules.get(name), "__file__", None) for name in (module, root))
    file = next(filter(None, files), None)
    if file is None:
        return root in sys.stdlib_module_names
    return file.startswith(_LIBRARY) or "site-packages" in file or "dist-packages" in file


def _is_of_library(method: Any) -> bool:
    """Return whether a bound method is a library's function, such as `random.gauss`, whose object does not count."""
    module = type(method.__self__).__module__
    return _is_installed(module) and getattr(sys.modules.get(module), method.__name__, None) is method


@functools.lru_cache(maxsize=None)
def _version(module: str) -> str:
    """Return the version of a library."""
    root = module.partition(".")[0]
    stated = getattr(sys.modules.get(root), "__version__", None)
    if stated is not None or not root or root in sys.stdlib_module_names:
        return str(stated or "")
    try:
        return importlib.metadata.version(root)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _is_of_interpreter(name: str, value: Any) -> bool:
    """Return whether a member is metadata of the interpreter, which may vary, and no method such as `__init__`."""
    return name == "_abc_impl" or (name.startswith("__") and not callable(value) and not isinstance(value, classmethod))
