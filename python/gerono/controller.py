"""Controllers written in Python: a class with a step."""

from __future__ import annotations

import copy
import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from gerono._samples import DTYPES, MODES

_INPUTS = ("vehicle/state", "path/reference")
_OUTPUTS = ("control/command", "control/adaptation", "control/errors", "control/telemetry")
# Integers up to this one are exact in floating point.
_LARGEST_WHOLE = 2**53
# Attributes that a flight sets, which are not part of the state.
FLIGHT_FIELDS = ("_flown", "adaptation", "telemetry")


class Now:
    """Time of a step: `tick`, `time` since the first tick, and `elapsed` since the last step, both in s."""

    __slots__ = ("elapsed", "tick", "time")

    def __init__(self) -> None:
        self.tick = 0
        self.time = 0.0
        self.elapsed = 0.0


# Modes of `control/command`; a sample of zeros has the first.
TORQUE, RATES = 0, 1

# Of each mode: the field that the vehicle takes, the one that it does not, and what the scenario does.
_FIELDS = {TORQUE: ("torque_body", "rates_body", "has no"), RATES: ("rates_body", "torque_body", "has")}
#: Mode of `control/command`: no command; the vehicle executes its failsafe.
FAILSAFE = 2


class Controller:
    """Base class of controllers that replace the built-in control laws.

    Numbers and numpy arrays, of the class or of the object, are its state: a flight saves and restores them, so that
    it can be repeated bit for bit, and faults and `Simulation.restore` work. They must all exist before the first
    step, and keep their shape. Texts, tuples, functions and modules are constants: a flight that changes one is
    refused. A class with state of any other type overrides `save` and `restore`. Now and then a flight restores the
    saved state in a copy of the object, which repeats some steps and must give the same outputs: state that is not
    saved is an error. After a flight the object has its final state; the next flight begins with the initial state of
    the first again, except for members set in between.

    `self.telemetry` has room for the numbers, at most 32, that `controller.telemetry` of the scenario names, and is
    recorded under these names; `self.adaptation` is the sample of `control/adaptation`.
    """

    telemetry: np.ndarray
    adaptation: np.void

    def step(self, now: Now, state: Any, reference: Any, command: Any, errors: Any) -> None:
        """Compute the command of one period.

        `state` and `reference` are the newest samples of `vehicle/state` and `path/reference`, or None before the
        first; `command` and `errors` are the samples of `control/command` and `control/errors` that are published, and
        are zero when the step begins. All are views of the same memory at every step: copy values that must outlive it.
        Frame {I} has its third axis down; the thrust, N, acts along −R e3; torques, N m, and rates, rad/s, are in {B}.
        """
        raise NotImplementedError

    def save(self) -> list[float]:
        """Return the state as numbers."""
        numbers: list[float] = []
        for name, value in self._state().items():
            items = np.ravel(value).tolist() if isinstance(value, np.ndarray) else [value]
            if isinstance(value, int) or getattr(value, "dtype", np.dtype(float)).kind in "iu":
                self._refuse_inexact(name, items)
            numbers.extend(map(float, items))
        return numbers

    def _refuse_inexact(self, name: str, items: list[Any]) -> None:
        for item in items:
            if abs(int(item)) > _LARGEST_WHOLE:
                raise ValueError(
                    f"{type(self).__name__}.{name} is the integer {item}, but a saved state is exact up to 2**53 only: split it "
                    "into two smaller numbers, store it as a text if it is constant, or override `save` and `restore`"
                )

    def restore(self, numbers: list[float]) -> None:
        """Restore the state returned by `save`."""
        offset = 0
        for name, value in self._state().items():
            if isinstance(value, np.ndarray):
                value[...] = np.reshape(numbers[offset : offset + value.size], value.shape)
                offset += value.size
            else:
                setattr(self, name, type(value)(numbers[offset]))
                offset += 1

    def _state(self) -> dict[str, Any]:
        return {name: value for name, value in sorted(vars(self).items()) if name not in FLIGHT_FIELDS and _is_state(value)}


def _is_state(value: Any) -> bool:
    return isinstance(value, (bool, int, float, np.ndarray, np.number, np.bool_))


def _is_saved(value: Any) -> bool:
    """Return whether a saved state holds a number or an array exactly."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.dtype.kind in "fiub" and value.dtype.itemsize <= 8
    return _is_state(value)


def _is_constant(value: Any) -> bool:
    if isinstance(value, tuple):
        return all(_is_state(item) or _is_constant(item) for item in value)
    return value is None or isinstance(value, str) or inspect.ismodule(value) or callable(value)


def refuse_other(controller: Any) -> None:
    """Refuse anything but an object of a controller's class."""
    if isinstance(controller, type):
        raise TypeError(f"a controller is an object: pass {controller.__name__}(), not the class")
    if not isinstance(controller, Controller):
        raise TypeError(f"a controller is a gerono.Controller, not a {type(controller).__name__}")


def _declare_state(controller: Controller) -> None:
    """Copy state that the class declares to the object, and refuse values that cannot be saved."""
    for kind in type(controller).__mro__:
        if kind in (Controller, object):
            break
        for name, value in vars(kind).items():
            if name.startswith("__") or name in vars(controller) or not _is_state(value):
                continue
            setattr(controller, name, value.copy() if isinstance(value, np.ndarray) else value)
    if type(controller).save is not Controller.save:
        return
    for name, value in vars(controller).items():
        if name in FLIGHT_FIELDS or _is_constant(value):
            continue
        if not _is_saved(value):
            what = type(value).__name__ + (f" of {value.dtype}" if isinstance(value, np.ndarray) else "")
            message = (
                f"{type(controller).__name__}.{name} is a {what}, which a flight cannot save: use numbers and numpy arrays of at "
                "most 64 bits, or override `save` and `restore`"
            )
            raise TypeError(message)


def _begin(controller: Controller) -> list[float]:
    """Restore the initial state of the first flight, except for members set since its end; return the state."""
    now = controller.save()
    if "_flown" not in vars(controller):
        return now
    flown = vars(controller)["_flown"]
    if flown is None or len(now) != len(flown[1]):
        raise RuntimeError(
            f"the last flight of {type(controller).__name__} has changed a constant, or the size of its state, so no other flight "
            "can begin with the state of the first: make a new object"
        )
    first, last = flown
    # Bits, because NaN does not equal itself.
    bits, last_bits = (np.array(numbers, np.float64).view(np.uint64) for numbers in (now, last))
    state: list[float] = np.where(bits == last_bits, first, now).tolist()
    controller.restore(state)
    return state


def _constants(controller: Controller) -> dict[str, Any]:
    """Return the present members of class and object that are not state; none if the class overrides `save`."""
    if type(controller).save is not Controller.save:
        return {}
    kinds = type(controller).__mro__
    own: dict[str, Any] = {}
    for kind in reversed(kinds[: kinds.index(Controller)]):
        own |= {name: value for name, value in vars(kind).items() if not name.startswith("__")}
    own |= vars(controller)
    return {name: _frozen(value) for name, value in own.items() if name not in FLIGHT_FIELDS and not _is_state(value)}


def _frozen(value: Any) -> Any:
    """Return a copy of a value that compares by content."""
    if isinstance(value, tuple | list):
        return type(value), [*map(_frozen, value)]
    if isinstance(value, dict):
        return type(value), [(key, _frozen(item)) for key, item in value.items()]
    if isinstance(value, set):
        return type(value), frozenset(value)
    if isinstance(value, np.ndarray):
        return value.dtype, value.shape, value.tobytes()
    return value


class _Telemetry(np.ndarray):
    """Array of the numbers that the scenario names; access beyond its end is an error, also in slices."""

    room: int

    def __array_finalize__(self, source: Any) -> None:
        self.room = getattr(source, "room", np.size(self))

    def __getitem__(self, key: Any) -> Any:
        self._refuse_outside(key)
        return super().__getitem__(key)

    def __setitem__(self, key: Any, value: Any) -> None:
        self._refuse_outside(key)
        values = np.asarray(value, np.float64)
        if values.ndim and values.size > self.room:
            raise ValueError(self._refusal())
        super().__setitem__(key, values)

    def _refuse_outside(self, key: Any) -> None:
        size = np.size(self)
        for part in key if isinstance(key, tuple) else (key,):
            is_slice = isinstance(part, slice)
            indices = (part.start or 0, part.stop or 0) if is_slice else np.ravel(part).tolist()
            for index in indices:
                is_index = isinstance(index, int | np.integer) and not isinstance(index, bool)
                if is_index and not -size <= index < size + is_slice:
                    raise IndexError(self._refusal())

    def _refusal(self) -> str:
        return (
            f"`telemetry` has room for {self.room} numbers, as many as `controller.telemetry` of the scenario names: add a name "
            "for each number that is written"
        )


def _words(topic: str) -> np.ndarray:
    return np.zeros(DTYPES[topic].itemsize // 8, np.uint64)


def _sample(topic: str, words: np.ndarray) -> Any:
    return words.view(DTYPES[topic])[0]


# Period and length of the trials of the saved state, steps. The first begins at the second step, when there is state to
# lose.
_TRIAL_PERIOD, _TRIAL_STEPS = 500, 10


def _copy_of(controller: Controller) -> Controller:
    """Return a controller with the same constants and a copy of the state."""
    second = copy.copy(controller)
    for name, value in vars(controller).items():
        if name not in FLIGHT_FIELDS and not _is_constant(value):
            try:
                setattr(second, name, copy.deepcopy(value))
            except Exception as error:
                raise TypeError(
                    f"{type(controller).__name__}.{name} cannot be copied ({error}), so a flight cannot check that the saved "
                    "state is complete: define `__deepcopy__` in its class"
                ) from error
    return second


# Arguments of a step with their topics.
_ARGUMENTS = dict(zip(("state", "reference", "command", "errors"), (*_INPUTS, _OUTPUTS[0], _OUTPUTS[2]), strict=True))


def _refuse_unknown_field(error: Exception) -> None:
    """Raise an error that names the existing fields, if the error is numpy's about one that does not exist."""
    _, found, name = str(error).partition("no field of name ")
    if not found:
        return
    lines = []
    for argument, topic in _ARGUMENTS.items():
        names = [field for field in DTYPES[topic].names or () if field not in ("tick", "stamp_ns", "seq")]
        lines.append(f"`{argument}` has " + ", ".join(names))
    raise ValueError(f"no sample has a field `{name.strip(chr(39))}`: " + "; ".join(lines)) from error


class Bridge:
    """Interface between a flight and a controller: memory for inputs and outputs, and a step that uses it."""

    def __init__(
        self, controller: Controller, mode: int = TORQUE, telemetry_size: int | None = None, has_trials: bool = True
    ) -> None:
        refuse_other(controller)
        self.now_words = np.zeros(3, np.uint64)
        self.input_words = [_words(topic) for topic in _INPUTS]
        self.output_words = [_words(topic) for topic in _OUTPUTS]
        self._state, self._reference = map(_sample, _INPUTS, self.input_words)
        self._command, adaptation, self._errors, telemetry = map(_sample, _OUTPUTS, self.output_words)
        self._modes = self.output_words[0].view(DTYPES[_OUTPUTS[0]])["mode"]
        controller.adaptation, controller.telemetry = adaptation, telemetry["values"][:telemetry_size].view(_Telemetry)
        self._flight_fields = controller.adaptation, controller.telemetry
        _declare_state(controller)
        self._first = _begin(controller) if has_trials else []
        self._constants = _constants(controller) if has_trials else {}
        self._controller = controller
        self._step: Callable[..., None] = controller.step
        self._mode = mode
        self._unread = self._command[_FIELDS[mode][1]]
        self._now = Now()
        self._times = self.now_words.view(np.float64)
        self.state_size = len(controller.save())
        self._second = Bridge(_copy_of(controller), mode, telemetry_size, has_trials=False) if has_trials else None
        self._steps = 0

    def step(self, arrived: int) -> None:
        """Advance the controller; bit i of `arrived` says whether input i has a sample."""
        second = self._second
        is_tried = second is not None and 1 <= self._steps % _TRIAL_PERIOD <= _TRIAL_STEPS
        self._steps += 1
        if second is None or not is_tried:
            self._advance(arrived)
            return
        before = self._saved()
        second._copy_inputs(self)
        self._advance(arrived)
        # After the first one's step, which therefore sees shared objects, such as module variables, as without a trial.
        second._controller.restore(before)
        second._advance(arrived)
        self._compare(second)
        if self._steps % _TRIAL_PERIOD > _TRIAL_STEPS:
            self._refuse_changed()

    def _advance(self, arrived: int) -> None:
        now = self._now
        now.tick = int(self.now_words[0])
        now.time = float(self._times[1])
        now.elapsed = float(self._times[2])
        if self._mode:
            self._command["mode"] = self._mode
        try:
            self._step(
                now,
                self._state if arrived & 1 else None,
                self._reference if arrived & 2 else None,
                self._command,
                self._errors,
            )
        except (KeyError, ValueError) as error:
            _refuse_unknown_field(error)
            raise
        mode = self._modes.item()
        if mode != FAILSAFE and (mode != self._mode or self._unread.any()):
            self._refuse(mode)
        own = self._controller
        if own.adaptation is not self._flight_fields[0] or own.telemetry is not self._flight_fields[1]:
            raise ValueError(
                f"{type(own).__name__} replaces its `adaptation` or `telemetry`, so nothing would be recorded: assign to its "
                "elements, such as `self.telemetry[:] = …`"
            )

    def _refuse(self, mode: int) -> None:
        name = type(self._controller).__name__
        if mode not in MODES:
            raise ValueError(
                f"{name} commands mode {mode}, which does not exist; there are "
                + ", ".join(f"{mode} ({name.lower()})" for mode, name in MODES.items())
            )
        taken, unread, has = _FIELDS[self._mode]
        because = f"but the scenario {has} `[controller.rates]`, so its vehicle takes `{taken}`"
        if mode != self._mode:
            wrong = "body rates" if mode == RATES else "torques"
            raise ValueError(f"{name} commands {wrong} (mode {mode}), {because}: leave the mode at {self._mode}")
        raise ValueError(f"{name} writes `{unread}`, {because}: write that")

    def _copy_inputs(self, first: Bridge) -> None:
        """Copy the memory of another bridge before its step."""
        self.now_words[:] = first.now_words
        own, others = self.input_words + self.output_words, first.input_words + first.output_words
        for words, given in zip(own, others):
            words[:] = given

    def _compare(self, second: Bridge) -> None:
        for topic, words, others in zip(_OUTPUTS, self.output_words, second.output_words):
            # The host writes the header.
            if words[3:].tobytes() != others[3:].tobytes():
                name = type(self._controller).__name__
                raise RuntimeError(
                    f"{name} forgets a part of its state: a copy that got the saved state wrote another `{topic}` at tick "
                    f"{self._now.tick}; keep everything on which a step depends besides its samples in numbers and arrays of the "
                    "object, or override `save` and `restore`"
                )

    def _saved(self) -> list[float]:
        numbers = self._controller.save()
        if len(numbers) != self.state_size:
            raise RuntimeError(
                f"the size of the state of {type(self._controller).__name__} has changed from {self.state_size} to {len(numbers)} "
                "numbers: declare all of it before the first step"
            )
        return numbers

    def _refuse_changed(self) -> None:
        """Refuse constants that the flight has changed, with which the next flight would begin."""
        before, now = self._constants, _constants(self._controller)
        for name in sorted(before.keys() | now.keys()):
            # In lists, where identical objects are equal whatever their `__eq__` returns.
            if [name in before, before.get(name)] != [name in now, now.get(name)]:
                raise RuntimeError(
                    f"a flight has changed {type(self._controller).__name__}.{name}, which is neither a number nor a numpy array, so "
                    "it is neither saved nor restored: use numbers instead, or override `save` and `restore`"
                )

    def __enter__(self) -> Bridge:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """Store the initial and the final state of the flight in the object; an error of the flight takes precedence."""
        own = self._controller
        vars(own)["_flown"] = None
        try:
            self._refuse_changed()
            vars(own)["_flown"] = self._first, own.save()
        except Exception:
            if error is None:
                raise

    def pack(self) -> list[float]:
        """Return the controller's state."""
        return self._saved()

    def unpack(self, numbers: list[float]) -> None:
        """Restore the controller's state."""
        self._controller.restore(numbers)
