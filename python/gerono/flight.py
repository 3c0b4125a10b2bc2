"""Flights and logs, with their samples as numpy arrays."""

from __future__ import annotations

import json
import os
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from gerono import _gerono
from gerono._samples import columns, samples_of

if TYPE_CHECKING:
    import pandas
    import polars
    import xarray


def namespace(text: str) -> Any:
    """Return JSON as objects: `summary.phases[1].ultimate`."""
    return json.loads(text, object_hook=lambda members: SimpleNamespace(**members))


class Tables:
    """Samples by topic, as arrays and as tables."""

    _telemetry: list[str] | None = None

    def __getitem__(self, topic: str) -> np.ndarray:
        """Return the samples of a topic as a structured array: `flight["control/errors"]["z1"]` has shape (n, 3)."""
        raise NotImplementedError

    def to_pandas(self, topic: str) -> pandas.DataFrame:
        """Return the samples of a topic as a `pandas.DataFrame`, vectors with a column for each axis."""
        import pandas

        return pandas.DataFrame(columns(self[topic], self._telemetry))

    def to_polars(self, topic: str) -> polars.DataFrame:
        """Return the samples of a topic as a `polars.DataFrame`, vectors with a column for each axis."""
        import polars

        return polars.DataFrame(columns(self[topic], self._telemetry))

    def to_xarray(self, topic: str) -> xarray.Dataset:
        """Return the samples of a topic as an `xarray.Dataset` over time, s."""
        import xarray

        samples = self[topic]
        variables = {}
        for name in samples.dtype.names or ():
            shape = samples[name].shape[1:]
            axes = [f"axis{length}" if length == 3 else f"{name}_{index}" for index, length in enumerate(shape)]
            axes = [axis if index == 0 else f"{axis}_{index}" for index, axis in enumerate(axes)]
            variables[name] = (("time", *axes), samples[name])
        return xarray.Dataset(variables, {"time": samples["stamp_ns"] / 1e9})


class Flight(Tables):
    """A flight in this process, whose samples are byte for byte those of `gerono run`.

    `summary` has the members of `summary.json` (docs/metrics.md) as attributes.
    """

    def __init__(self, flown: _gerono.Flight, scenario: Any) -> None:
        self._flown = flown
        self.summary = namespace(flown._summary())
        self._telemetry = scenario["controller"].get("telemetry")

    def __getitem__(self, topic: str) -> np.ndarray:
        return samples_of(topic, self._flown._words(topic))

    @property
    def topics(self) -> list[str]:
        """Topics that have samples."""
        return self._flown.topics

    @cached_property
    def digest(self) -> str:
        """Hash over all messages, as `gerono digest` prints it."""
        return self._flown.digest

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write `run.mcap`, byte for byte that of `gerono run`, and `summary.json` into a folder; return the log's path."""
        return self._flown.save(Path(folder))

    def __reduce__(self) -> NoReturn:
        raise TypeError("a Flight cannot be pickled: save it with `Flight.save`, and open it with `gerono.Log`")

    def __copy__(self) -> Flight:
        return self  # immutable

    def __deepcopy__(self, memo: object) -> Flight:
        return self

    def __repr__(self) -> str:
        steady = self.summary.steady
        distance = f"{100 * steady.rmse:.4g} cm from the path in steady state" if steady else "no steady state"
        return f"<Flight: {self.summary.outcome}, {distance}>"


class Log(Tables):
    """The log of a simulated or real flight, complete or damaged.

    `path` is a log or the folder of a run. A truncated or damaged log has the samples before the damage, and `damage`
    describes the loss.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._log = _gerono.Log(Path(path))
        self.scenario = namespace(self._log._scenario())
        self._telemetry = getattr(self.scenario.controller, "telemetry", None)
        self._read: dict[str, np.ndarray] = {}
        self._damage: str | None = None

    @property
    def damage(self) -> str | None:
        """Loss of data of a damaged or truncated log, or None; reads the log."""
        if not self._read:
            self["run/events"]
        return self._damage

    @property
    def path(self) -> Path:
        """File of the log."""
        return self._log.path

    @cached_property
    def summary(self) -> Any:
        """Content of `summary.json` beside the log, or None without one."""
        beside = self.path.parent / "summary.json"
        return namespace(beside.read_text()) if beside.exists() else None

    def __getitem__(self, topic: str) -> np.ndarray:
        if topic not in self._read:
            words, damage = self._log._words(topic)
            self._damage = damage or self._log.recovery
            self._read[topic] = samples_of(topic, words)
        return self._read[topic]

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.path,)

    def __repr__(self) -> str:
        return f"<Log {self.path}{': ' + self.damage if self.damage else ''}>"
