"""Sweeps: thousands of flights with varied values, their rows and their statistics."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from gerono import _gerono
from gerono._identity import Shared, identity_of, numbers_of
from gerono.controller import Bridge, Controller, refuse_other
from gerono.flight import namespace
from gerono.scenario import Scenario, Settings, bridge_of, name_of, refuse_seed, settings_of, toml_of

if TYPE_CHECKING:
    import os

    import pandas
    import polars

Vary = Mapping[str, Any]
Make = Callable[[], Controller]


def uniform(low: float, high: float, levels: int | None = None) -> Vary:
    """Vary uniformly between two bounds; in a grid with five levels, or as many as stated."""
    return _stated(uniform=[low, high], levels=levels)


def log_uniform(low: float, high: float, levels: int | None = None) -> Vary:
    """Vary log-uniformly between two positive bounds; levels as in `uniform`."""
    return _stated(log_uniform=[low, high], levels=levels)


def normal(
    mean: float,
    deviation: float,
    min: float | None = None,  # noqa: A002
    max: float | None = None,  # noqa: A002
    levels: int | None = None,
) -> Vary:
    """Vary by a normal distribution, truncated at bounds; levels as in `uniform`."""
    return _stated(normal=[mean, deviation], min=min, max=max, levels=levels)


def _stated(**values: Any) -> Vary:
    return {name: value for name, value in values.items() if value is not None}


def choice(*values: Any) -> Vary:
    """Vary between the given values."""
    return {"choice": list(values)}


class Rate(NamedTuple):
    """Share of flights that met a criterion, with its Wilson interval for random samples; None if none was flown."""

    value: float | None
    low: float | None
    high: float | None
    met: int
    flown: int

    def __str__(self) -> str:
        if self.value is None:
            return "none flown"
        interval = "" if self.low is None else f" [{self.low:.4g}, {self.high:.4g}]"
        return f"{self.value:.4g}{interval}"


class Sweep:
    """Results of a sweep: its folder has `results.parquet`, `sweep.json`, `sweep.md` and the page `index.html`."""

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self.summary = namespace((self.folder / "sweep.json").read_text())
        self._temporary_folder: Any = None

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
        """Return the share of flights that met a criterion, of a law [default: the first]."""
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
        rates = {law.name: self.rate(law=law.name) for law in self.summary.laws}
        survived = ", ".join(f"{law} {rate.met} of {rate.flown}" for law, rate in rates.items())
        return f"<Sweep {self.folder}: {self.summary.samples} samples, survived: {survived}>"


# Name of the only law of a sweep that compares none.
_ONLY = "as stated"


def sweep_text(
    scenario: Scenario,
    samples: int | None,
    seed: int,
    method: str,
    vary: Mapping[str, Any],
    laws: Mapping[str, list[str]],
    judge: Mapping[str, str] | None,
    require: Sequence[str],
    sets: list[str],
    logs: str,
    rank: str | None = None,
    own: Mapping[str, str] | None = None,
) -> str:
    """Return a sweep as the text of a `sweep.toml`.

    `laws` has the settings of the compared laws by name, and `own` the identities of controllers in Python.
    """
    own = own or {}
    lines = [f"scenario = {toml_of(str(scenario.path))}", f"seed = {seed}", f"method = {toml_of(method)}"]
    if samples is not None:
        lines.append(f"samples = {samples}")
    if rank is not None:
        lines.append(f"rank = {toml_of(rank)}")
    lines += [f"set = {toml_of(sets)}", f"require = {toml_of(list(require))}"]
    if not laws and own:
        lines.append(f"own = {toml_of(own[_ONLY])}")
    lines += ["[vary]", *(f"{toml_of(key)} = {toml_of(value)}" for key, value in vary.items())]
    for name, settings in laws.items():
        lines += ["[[compare]]", f"name = {toml_of(name)}", f"set = {toml_of(settings)}"]
        if name in own:
            lines.append(f"own = {toml_of(own[name])}")
    lines += ["[judge]", *(f"{toml_of(key)} = {toml_of(value)}" for key, value in (judge or {}).items())]
    lines += ["[keep]", f"logs = {toml_of(logs)}"]
    return "\n".join(lines) + "\n"


def sweep(
    scenario: Scenario,
    vary: Mapping[str, Any],
    samples: int | None = None,
    seed: int = 1,
    method: str = "random",
    compare: Mapping[str, Settings | Make] | None = None,
    judge: Mapping[str, str] | None = None,
    require: Sequence[str] = (),
    set: Settings = None,  # noqa: A002
    controller: Make | None = None,
    folder: str | os.PathLike[str] | None = None,
    jobs: int | None = None,
    logs: str = "none",
    rank: str | None = None,
) -> Sweep:
    """Fly a sweep in this process, on all cores or `jobs` of them, and return its results.

    The arguments are the keys of `sweep.toml` (docs/sweeps.md) except `map`, and the rows those of `gerono sweep`. `vary`
    takes `uniform`, `log_uniform`, `normal`, `choice`, a constant, an expression of other varied values, or a list of
    these; `compare` has settings or controllers by name, all flown on the same samples: `{"mine": Mine, "indi":
    {"controller.law": "indi"}}` gives the paired statistics of a class and a law. In a `folder` an interrupted sweep
    is continued, a complete one is only read, and one with other values, code or build is refused; without a folder the
    results exist as long as the returned object.

    A controller is made for each flight by a class or a function; `controller` makes that of every law. Its settings
    may not choose another controller or set gains of a built-in law. A flight that raises or is interrupted
    leaves no row. Flights of such a sweep follow one another on one core, because of Python's lock; `multiprocessing`
    with other `seed`s uses more.
    """
    makes = _makes(controller, compare)
    # Read once: they may be iterators.
    sets = settings_of(set)
    laws = {name: settings_of(None if callable(entry) else entry) for name, entry in (compare or {}).items()}
    for stated in (sets, *laws.values()):
        refuse_seed(stated, "the argument `seed` gives each flight of a sweep its own")
    if jobs is not None and jobs < 1:
        raise ValueError(f"a sweep flies on one core at least, not on {jobs}: omit `jobs` for all cores")
    if makes and jobs not in (None, 1):
        raise ValueError(f"flights of a controller in Python follow one another on one core, not on {jobs}: omit `jobs`")
    temporary_folder = None
    if folder is None:
        temporary_folder = tempfile.TemporaryDirectory(prefix="gerono-sweep-")
        folder = temporary_folder.name
    if not makes:
        text = sweep_text(scenario, samples, seed, method, vary, laws, judge, require, sets, logs, rank)
        _gerono.run_sweep(text, scenario.path, scenario.text, Path(folder), jobs)
    else:
        if logs != "none":
            raise ValueError("flights of a controller in Python write no logs: fly the sample again and save it")
        values = {}
        for law in makes:
            own_sets = laws.get(law, sets)
            own_sets += scenario._beside_own(sets + laws.get(law, []))
            law_settings = sets + laws.get(law, [])
            # Varied keys are settings as well.
            varied = [f"{key}=0" for key in vary if key.partition(".")[0] == "controller"]
            scenario._check_own(law_settings, varied)
            values[law] = scenario.values(law_settings)
        first = {law: make() for law, make in makes.items()}
        for made in first.values():
            refuse_other(made)
        own = {law: identity_of(made) for law, made in first.items()}
        shared: Shared = {}
        numbers = {law: numbers_of(made, shared) for law, made in first.items()}
        text = sweep_text(scenario, samples, seed, method, vary, laws, judge, require, sets, logs, rank, own)

        def make_own(law: str) -> tuple[Bridge, str] | None:
            if law not in makes:
                return None
            made = makes[law]()
            refuse_other(made)
            if numbers_of(made, shared.copy()) != numbers[law]:
                raise RuntimeError(
                    f"the controller of {law!r} is not the same at every call, but all its flights count for one law: make a new "
                    "object with the same content each time"
                )
            return bridge_of(made, values[law]), name_of(made)

        _gerono.sweep_with(text, scenario.path, scenario.text, Path(folder), make_own)
    results = Sweep(folder)
    results._temporary_folder = temporary_folder
    return results


def _makes(controller: Make | None, compare: Mapping[str, Settings | Make] | None) -> dict[str, Make]:
    """Return the functions that make controllers, by law."""
    for entry in (controller, *(compare or {}).values()):
        if isinstance(entry, Controller):
            raise TypeError(
                "a controller is made for each flight: pass the class or a function that makes one, not a "
                f"{type(entry).__name__} object"
            )
    if controller is not None and not callable(controller):
        raise TypeError(f"`controller` is a class or a function that makes a controller, not {controller!r}")
    if controller is None:
        return {name: entry for name, entry in (compare or {}).items() if callable(entry)}
    if any(callable(entry) for entry in (compare or {}).values()):
        raise ValueError("`controller` flies every law: name classes in `compare` only, or only settings")
    return dict.fromkeys(compare or (_ONLY,), controller)
