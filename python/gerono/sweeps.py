"""Sweeps: thousands of varied flights, their rows and their statistics."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from gerono import _gerono
from gerono.controller import Bridge, Controller
from gerono.flight import namespace
from gerono.scenario import Scenario, Settings, bridge_of, settings_of, toml_of

if TYPE_CHECKING:
    import os

    import pandas
    import polars

Vary = Mapping[str, Any]


def uniform(low: float, high: float) -> Vary:
    """Return what is drawn evenly between two bounds."""
    return {"uniform": [low, high]}


def log_uniform(low: float, high: float) -> Vary:
    """Return what is drawn evenly in its logarithm between two positive bounds."""
    return {"log_uniform": [low, high]}


def normal(mean: float, deviation: float, min: float | None = None, max: float | None = None) -> Vary:  # noqa: A002
    """Return what is drawn from a normal distribution, cut off at bounds."""
    bounds = {"min": min, "max": max}
    return {"normal": [mean, deviation]} | {name: bound for name, bound in bounds.items() if bound is not None}


def choice(*values: Any) -> Vary:
    """Return what is one of some values."""
    return {"choice": list(values)}


class Rate(NamedTuple):
    """Share of flights that met a criterion, with its Wilson interval, which only random samples have."""

    value: float
    low: float | None
    high: float | None
    met: int
    flown: int

    def __str__(self) -> str:
        interval = "" if self.low is None else f" [{self.low:.4g}, {self.high:.4g}]"
        return f"{self.value:.4g}{interval}"


class Sweep:
    """Results of a sweep: its folder has `results.parquet`, `sweep.json`, `sweep.md` and the page `index.html`."""

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self.summary = namespace((self.folder / "sweep.json").read_text())
        self._keep: Any = None

    @property
    def parquet(self) -> Path:
        """File of the rows."""
        return self.folder / "results.parquet"

    def to_pandas(self) -> pandas.DataFrame:
        """Return the rows as a `pandas.DataFrame`."""
        import pandas

        return pandas.read_parquet(self.parquet)

    def to_polars(self) -> polars.DataFrame:
        """Return the rows as a `polars.DataFrame`."""
        import polars

        return polars.read_parquet(self.parquet)

    def rate(self, criterion: str = "survived", law: str | None = None) -> Rate:
        """Return the share of flights that met a criterion; of several laws, of the first unless one is named."""
        laws = {entry.name: entry for entry in self.summary.laws}
        if law is not None and law not in laws:
            raise KeyError(f"no {law!r} was compared; there are {', '.join(laws)}")
        chosen = laws[law] if law is not None else self.summary.laws[0]
        criteria = {entry.name: entry for entry in chosen.criteria}
        if criterion not in criteria:
            raise KeyError(f"there is no criterion {criterion!r}; there are {', '.join(criteria)}")
        found = criteria[criterion]
        low, high = getattr(found, "wilson", None) or (None, None)
        return Rate(found.rate, low, high, found.met, found.flown)

    def __repr__(self) -> str:
        return f"<Sweep {self.folder}: {self.summary.samples} samples, {self.rate()} survived>"


def sweep_text(
    scenario: Scenario,
    samples: int | None,
    seed: int,
    method: str,
    vary: Mapping[str, Any],
    compare: Mapping[str, Settings] | None,
    judge: Mapping[str, str] | None,
    require: Sequence[str],
    set: Settings,  # noqa: A002
    logs: str,
) -> str:
    """Return a sweep as the text of a `sweep.toml`."""
    lines = [f"scenario = {toml_of(str(scenario.path))}", f"seed = {seed}", f"method = {toml_of(method)}"]
    if samples is not None:
        lines.append(f"samples = {samples}")
    lines += [f"set = {toml_of(settings_of(set))}", f"require = {toml_of(list(require))}"]
    lines += ["[vary]", *(f"{toml_of(key)} = {toml_of(value)}" for key, value in vary.items())]
    for name, settings in (compare or {}).items():
        lines += ["[[compare]]", f"name = {toml_of(name)}", f"set = {toml_of(settings_of(settings))}"]
    lines += ["[judge]", *(f"{toml_of(key)} = {toml_of(value)}" for key, value in (judge or {}).items())]
    lines += ["[keep]", f"logs = {toml_of(logs)}"]
    return "\n".join(lines) + "\n"


def sweep(
    scenario: Scenario,
    vary: Mapping[str, Any],
    samples: int | None = None,
    seed: int = 1,
    method: str = "random",
    compare: Mapping[str, Settings] | None = None,
    judge: Mapping[str, str] | None = None,
    require: Sequence[str] = (),
    set: Settings = None,  # noqa: A002
    controller: Callable[[], Controller] | None = None,
    folder: str | os.PathLike[str] | None = None,
    jobs: int | None = None,
    logs: str = "none",
) -> Sweep:
    """Fly a sweep in this process, on all cores or `jobs` of them, and return its results.

    The arguments are the keys of `sweep.toml` (docs/sweeps.md), and the rows those of `gerono sweep`. `vary` takes
    `uniform`, `log_uniform`, `normal`, `choice`, a constant, an expression of other varied values, or a list of these;
    `compare` has settings by name, all flown on the same samples. In a `folder` an interrupted sweep goes on where it
    was; without one the results live as long as the returned object.

    `controller` makes the controller of each flight: a class, or a function. Flights with one follow each other on
    one core, as Python's lock wants it; `multiprocessing` with other `seed`s uses more.
    """
    keep = None
    if folder is None:
        keep = tempfile.TemporaryDirectory(prefix="gerono-sweep-")
        folder = keep.name
    text = sweep_text(scenario, samples, seed, method, vary, compare, judge, require, set, logs)
    if controller is None:
        _gerono.run_sweep(text, scenario.path, scenario.text, Path(folder), jobs)
    else:
        values = scenario.values(set)
        make = controller

        def bridge() -> Bridge:
            return bridge_of(make(), values)

        _gerono.sweep_with(text, scenario.path, scenario.text, Path(folder), bridge)
    results = Sweep(folder)
    results._keep = keep
    return results
