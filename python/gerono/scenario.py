"""Scenarios and their flights."""

from __future__ import annotations

import copyreg
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from gerono import _gerono
from gerono._samples import samples_of
from gerono.controller import RATES, TORQUE, Bridge, Controller
from gerono.flight import Flight

Settings = Mapping[str, Any] | Iterable[str] | None


def _text(text: str) -> str:
    """Return a text as TOML, which has no halves of surrogate pairs, and no bare control characters."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise ValueError(f"{text!r} has half of a surrogate pair, which is no character: remove it") from error
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_of(value: Any) -> str:
    """Return a value as TOML: numbers, texts, lists and tables."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, bool):
        return json.dumps(value)
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, float) and not np.isfinite(value):
        return {np.inf: "inf", -np.inf: "-inf"}.get(value, "nan")
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_text(str(key))} = {toml_of(item)}" for key, item in value.items()) + " }"
    if isinstance(value, Iterable):
        return "[" + ", ".join(map(toml_of, value)) + "]"
    raise TypeError(f"a scenario has no values of type {type(value).__name__}")


def settings_of(settings: Settings) -> list[str]:
    """Return settings as arguments of `--set`: from a mapping, or a list of them as it is."""
    if isinstance(settings, Mapping):
        return [f"{key}={toml_of(value)}" for key, value in settings.items()]
    if settings is None:
        return []
    texts = list(settings) if isinstance(settings, Iterable) and not isinstance(settings, str) else [settings]
    if isinstance(settings, str) or not all(isinstance(text, str) for text in texts):
        raise TypeError(f"settings are a mapping, such as {{'duration': 1.0}}, or a list of texts, not {settings!r}")
    return texts


def refuse_seed(sets: Iterable[str], reason: str) -> None:
    """Refuse a setting of the seed, which would have no effect."""
    if any(setting.partition("=")[0].strip().strip("'\"") == "seed" for setting in sets):
        raise ValueError(f"`seed` in the settings has no effect: {reason}")


def _stated(settings: Settings, seed: int | None) -> list[str]:
    """Return settings; refuse a second seed among them."""
    sets = settings_of(settings)
    if seed is not None:
        refuse_seed(sets, "the argument `seed` replaces it; remove one of them")
    return sets


class Observation(NamedTuple):
    """Inputs of a controller: the newest samples of `vehicle/state` and `path/reference`, or None before the first."""

    state: np.void | None
    reference: np.void | None


class Scenario:
    """A scenario: the file that `gerono run` flies, with the same checks and the same messages.

    `text` replaces the content of the file, whose folder is then only used to find the files that the scenario names.
    """

    def __init__(self, path: str | os.PathLike[str], text: str | None = None) -> None:
        self._scenario = _gerono.Scenario(Path(path), text)

    @property
    def path(self) -> Path:
        """File of the scenario."""
        return self._scenario.path

    @property
    def text(self) -> str:
        """Text of the scenario."""
        return self._scenario.text

    def values(self, set: Settings = None, seed: int | None = None) -> dict[str, Any]:  # noqa: A002
        """Return all values of the scenario by their keys (docs/scenarios.md), in SI units and rad."""
        values: dict[str, Any] = json.loads(self._scenario._json(_stated(set, seed), seed))
        return values

    def fly(
        self,
        seed: int | None = None,
        set: Settings = None,  # noqa: A002
        controller: Controller | None = None,
        topics: Iterable[str] | None = None,
    ) -> Flight:
        """Fly in this process, as fast as possible and without Python's lock; return the flight.

        `set` changes keys, as `--set` does: `{"controller.k1": 5.0}`. `controller` replaces the built-in law, whose gains
        `set` may not change then.
        `topics` are recorded [default: all, which `Flight.save` and `Flight.digest` need].
        """
        sets = _stated(set, seed)
        if controller is not None:
            sets += self._beside_own(sets, seed)
        values = self.values(sets, seed)
        recorded = None if topics is None else list(topics)
        if controller is None:
            return Flight(self._scenario._fly(sets, seed, recorded, None), values)
        with bridge_of(controller, values) as bridge:
            flown = self._scenario._fly(sets, seed, recorded, (bridge, name_of(controller)))
        return Flight(flown, values)

    def _beside_own(self, sets: list[str], seed: int | None = None) -> list[str]:
        """Return further settings that a controller in Python needs."""
        # Telemetry needs a program in place of the controller, which a controller in Python is.
        program = ['programs.controller=["python"]']
        try:
            has_telemetry = self.values(sets + program, seed)["controller"].get("telemetry")
        except _gerono.ScenarioError:
            return []  # the caller reports errors of the settings
        return program if has_telemetry else []

    def _check_own(self, sets: list[str], varied: list[str]) -> None:
        self._scenario._check_own(sets, varied)

    def start(self, seed: int | None = None, set: Settings = None) -> Simulation:  # noqa: A002
        """Begin a flight that is advanced step by step, with commands passed to `step` instead of those of a law."""
        sets = _stated(set, seed)
        self._check_own(sets, [])
        has_rates = bool(self.values(sets, seed)["controller"].get("rates"))
        return Simulation(self._scenario._start(sets, seed), has_rates)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.path, self.text)

    def __repr__(self) -> str:
        return f"gerono.Scenario({str(self.path)!r})"


def name_of(controller: Controller) -> str:
    """Return the name of a controller in a log: module and class."""
    return f"{type(controller).__module__}.{type(controller).__qualname__}"


def bridge_of(controller: Controller, values: Mapping[str, Any]) -> Bridge:
    """Return the bridge of a controller in a scenario."""
    section = values["controller"]
    return Bridge(controller, RATES if section.get("rates") else TORQUE, len(section.get("telemetry") or ()))


class Simulation:
    """A flight between two steps of its controller.

    `time` is that of the next step; the command passed to `step` acts from there on, as that of a controller in the
    flight would.
    """

    def __init__(self, simulation: _gerono.Simulation, has_rates: bool) -> None:
        self._simulation = simulation
        self._has_rates = has_rates

    @property
    def time(self) -> float:
        """Time of the next step, s."""
        return self._simulation.time

    @property
    def done(self) -> bool:
        """Whether the flight has ended."""
        return self._simulation.done

    @property
    def lost(self) -> str | None:
        """Why and when the vehicle was lost, or None."""
        return self._simulation.lost

    def observe(self) -> Observation:
        """Return the present inputs of a controller."""
        return Observation(self["vehicle/state"], self["path/reference"])

    def step(
        self,
        thrust: float,
        torque_body: Iterable[float] | None = None,
        rates_body: Iterable[float] | None = None,
    ) -> Observation:
        """Command a thrust, N, and a torque, N m, or body rates, rad/s, for one period of the controller.

        Returns the controller's inputs at its next step. The vehicle follows body rates if the scenario has
        `[controller.rates]`, and torques otherwise; arguments left out are zero.
        """
        if (torque_body if self._has_rates else rates_body) is not None:
            given, followed = ("torque_body", "rates_body") if self._has_rates else ("rates_body", "torque_body")
            has = "has" if self._has_rates else "has no"
            raise ValueError(
                f"`{given}` has no effect, because the scenario {has} `[controller.rates]`: command `{followed}`"
            )
        if self.done:
            self._simulation.save()  # raises if a step has failed
            raise RuntimeError("the flight is at its end: `restore` a snapshot, or `start` another flight")
        zero = (0.0, 0.0, 0.0)
        torque, rates = ([*map(float, zero if turn is None else turn)] for turn in (torque_body, rates_body))
        self._simulation._step(float(thrust), torque, rates)
        return self.observe()

    def __getitem__(self, topic: str) -> np.void | None:
        """Return the newest sample of a topic, or None before the first; no service receives `vehicle/truth`."""
        words = self._simulation._newest(topic)
        return None if words is None else samples_of(topic, words)[0]

    def save(self) -> _gerono.Snapshot:
        """Return the exact state of all services and of the samples in transit between them."""
        return self._simulation.save()

    def restore(self, snapshot: _gerono.Snapshot) -> None:
        """Restore a saved state of this flight, any number of times; that of another flight is a ValueError."""
        self._simulation.restore(snapshot)

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "a Simulation cannot be pickled or copied: `start` another one with the same scenario and seed, and `restore` a "
            "snapshot of this one, or repeat its steps in another process"
        )

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def _refuse_snapshot(snapshot: _gerono.Snapshot) -> NoReturn:
    raise TypeError(
        "a Snapshot cannot be pickled or copied: it does not change, and any simulation of its flight in this process may "
        "`restore` it"
    )


# A compiled class, to which no method can be added here.
copyreg.pickle(_gerono.Snapshot, _refuse_snapshot)
