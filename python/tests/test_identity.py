"""The identity of a controller: another one where any content differs, and the same one in every process."""

import contextlib
import enum
import functools
import logging
import numbers
import os
import subprocess
import sys
import threading
import types
from random import gauss

import controller
import numpy as np
import pytest
from numpy.random import normal

from gerono._identity import identity_of, numbers_of


class Gains:
    def __init__(self, gain):
        self.gain = gain

    def __call__(self, error):
        return self.gain * error

    def __getstate__(self):
        return {}


class Slots:
    __slots__ = ("gain", "unset")

    def __init__(self, gain):
        self.gain = gain


class Choice(enum.Enum):
    FIRST = 1.0
    SECOND = 2.0


def circle(gain):
    first, second = Slots(gain), Slots(0.0)
    first.unset, second.unset = second, {first, second, "text"}
    return first


def wraps_a_library(gain):
    @functools.wraps(np.linalg.norm)
    def norm(error):
        return gain * error

    return norm


CONTENTS = {
    "object": Gains,
    "slots": Slots,
    "member": Choice,
    "method": lambda gain: Gains(gain).__call__,
    "builtin method": lambda gain: np.random.default_rng(int(gain)).normal,
    "closure": wraps_a_library,
    "partial": lambda gain: functools.partial(pow, gain),
    "keywords": lambda gain: functools.partial(pow, mod=gain),
    "polynomial": lambda gain: np.poly1d([1.0, gain]),
    "set": lambda gain: {"a", "b", ("c", gain)},
    "frozenset": lambda gain: frozenset({"a", frozenset({"b", gain})}),
    "dict": lambda gain: {("a", 1): gain, Choice.FIRST: 2},
    "namespace": lambda gain: types.SimpleNamespace(gain=gain),
    "objects in an array": lambda gain: np.array([Gains(gain), None], object),
    "structure": lambda gain: np.array([(1, gain)], np.dtype([("a", "u1"), ("b", "f8")], align=True)),
    "mask": lambda gain: np.ma.masked_array([1.0, 2.0], [gain > 1.0, False]),
    "circle": circle,
    "class": lambda gain: type("Made", (), {"gain": gain}),
}


def law(where, value):
    if where == "object":
        made = controller.Hover()
        made.value = value
        return made
    return type("Law", (controller.Hover,), {"value": value})()


@pytest.mark.parametrize("where", ["object", "class"])
@pytest.mark.parametrize("name", CONTENTS)
def test_any_content_counts(name, where):
    first, same, other = (law(where, CONTENTS[name](gain)) for gain in (1.0, 1.0, 2.0))
    assert identity_of(first) == identity_of(same) != identity_of(other)
    shared = {}
    for known in (None, shared, shared):
        assert numbers_of(first, known) == numbers_of(same, known) != numbers_of(other, known)


def test_identities_are_of_code_and_numbers():
    def made(source, **numbers):
        names = {"Hover": controller.Hover, "__name__": "written"}
        exec(source, names)  # noqa: S102
        law = names["Law"]()
        vars(law).update(numbers)
        return identity_of(law)

    source = "gain = 2.0\ndef help(x): return gain * x\nclass Law(Hover):\n    k = 1.0\n    def step(self, *all): help(self.k)\n"
    same = made(source)
    assert made(source) == same
    others = [source.replace("2.0", "2.5"), source.replace("gain * x", "gain + x"), source.replace("1.0", "1.5")]
    assert len({same, made(source, k=3.0), *map(made, others)}) == 5


class Counts:
    """A helper that counts in its class, and in a variable of its module."""

    calls = 0

    def __call__(self, error):
        global counted
        counted += 1
        Counts.calls += 1
        return error


counted = 0


def helped(gain):
    def count(error):
        nonlocal calls
        calls += 1
        return error

    class Helper(Counts):
        values = [gain]

    calls = 0
    return [Counts(), Helper(), count, list(Choice), {Choice.FIRST, Choice.SECOND}], [Helper.values.clear, lambda: count(0.0)]


@pytest.mark.parametrize("where", ["object", "class"])
def test_numbers_do_not_count_what_objects_share(where):
    content, changes = helped(1.0)
    made, shared = law(where, content), {}
    first = numbers_of(made, shared)
    assert numbers_of(law(where, helped(1.0)[0]), shared.copy()) == first
    assert numbers_of(law(where, helped(2.0)[0]), shared.copy()) != first
    for change in (lambda: Counts()(0.0), *changes):
        change()
        assert numbers_of(made, shared) == first
    content.append(1.0)
    # A list of the object is its own, and that of a class is shared.
    assert (numbers_of(made, shared) == first) == (where == "class")


USES = """
import controller
import laws.gains
from gerono._identity import identity_of

class Law(controller.Hover):
    modes = {"one", "two", "three", frozenset({"four", "five"})}
    def step(self, *all):
        from laws import late
        return laws.gains.half(laws.gains.KP) + late.KI

if __name__ == "__main__":
    print(identity_of(Law()))
"""


def test_what_the_code_uses_of_other_modules_counts_in_every_process(tmp_path):
    def identity(seed="1", **changed):
        texts = {"gains": "KP = 4.0\nPART = 0.5\ndef half(x): return PART * x\n", "late": "KI = 1.0\nUNUSED = 1.0\n"}
        (tmp_path / "laws").mkdir(exist_ok=True)
        for name, text in (texts | changed).items():
            (tmp_path / "laws" / f"{name}.py").write_text(text)
        (tmp_path / "flies.py").write_text(USES)
        path = os.pathsep.join(filter(None, sys.path))
        environment = os.environ | {"PYTHONPATH": path, "PYTHONHASHSEED": seed, "PYTHONDONTWRITEBYTECODE": "1"}
        run = subprocess.run([sys.executable, tmp_path / "flies.py"], env=environment, capture_output=True, text=True, check=True)
        return run.stdout

    whole = identity()
    assert identity(seed="2") == whole
    assert identity(late="KI = 1.0\nUNUSED = 2.0\n") == whole
    gains = "KP = 4.0\nPART = 0.5\ndef half(x): return PART * x\n"
    others = [gains.replace("4.0", "5.0"), gains.replace("0.5", "0.6"), gains.replace("PART * x", "x")]
    assert len({whole, identity(late="KI = 2.0\n"), *(identity(gains=other) for other in others)}) == 5


def test_what_has_no_content_is_refused():
    assert identity_of(law("object", [threading.Lock(), np.sin, np.dtype("f8"), max, np.linalg.norm]))
    for value in (np.frompyfunc(lambda error: error, 1, 1), (number for number in ()), memoryview(b"")):
        with pytest.raises(TypeError, match=r"Law\.value is a .*, whose content cannot be read"):
            identity_of(law("class", [value]))


log = logging.getLogger(__name__)


@functools.singledispatch
def saturated(value):
    return value


@saturated.register
def _(value: numbers.Real):
    return min(value, 1.0)


@contextlib.contextmanager
def measured():
    yield gauss(0.0, 1.0) + normal()


class Ordinary(controller.Hover):
    """A controller that logs, dispatches by types and uses generators of libraries."""

    dispatch = functools.singledispatchmethod(lambda self, value: value)

    def step(self, now, *samples):
        log.debug("a step")
        with measured() as noise:
            saturated(noise)


def test_what_libraries_keep_for_themselves_does_not_count(monkeypatch):
    for logger in (log, logging.root):
        monkeypatch.setattr(logger, "handlers", [])
        monkeypatch.setattr(logger, "level", logger.level)
    law = Ordinary()
    first = identity_of(law)
    changes = [
        lambda: logging.getLogger("other"),
        lambda: law.step(None),
        lambda: log.addHandler(logging.StreamHandler()),
        lambda: log.setLevel(logging.DEBUG),
        lambda: law.step(None),
        lambda: logging.basicConfig(),
    ]
    for change in changes:
        change()
        assert identity_of(law) == first


def test_what_a_dispatching_function_calls_counts(monkeypatch):
    def dispatching(gain):
        dispatched = functools.singledispatch(lambda value: value)
        dispatched.register(float, lambda value: gain * value)
        return dispatched

    first, same, other = (law("class", dispatching(gain)) for gain in (1.0, 1.0, 2.0))
    assert identity_of(first) == identity_of(same) != identity_of(other)
    whole = identity_of(Ordinary())
    for name, value in {"log": logging.getLogger("another"), "gauss": np.random.standard_normal}.items():
        with monkeypatch.context() as changed:
            changed.setattr(sys.modules[__name__], name, value)
            assert identity_of(Ordinary()) != whole
    assert identity_of(Ordinary()) == whole


def test_functions_of_gerono_count_by_their_names():
    math = pytest.importorskip("gerono.math")
    first, same, other = (law("class", function) for function in (math.sin, math.sin, math.cos))
    assert identity_of(first) == identity_of(same) != identity_of(other)
