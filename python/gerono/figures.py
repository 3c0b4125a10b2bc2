"""Figures of a sweep for a paper: the distribution of a result, and the differences of laws sample by sample.

    python -m gerono.figures runs/sweep-laboratory

writes both as SVG and as PDF with embedded fonts, into the folder of the results. `distribution` and `differences` draw
into given axes. Needs `pip install ".[figures]"`.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib

from gerono.sweeps import Sweep

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    import pandas
    from matplotlib.axes import Axes

# Colours for all colour vision (Okabe and Ito).
_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#f0e442")

# Results of flights (docs/sweeps.md) with the unit in which they are drawn, and the factor from the column's unit. The rows
# do not state the units of varied keys.
_DISTANCES = "rmse mean deviation p50 p95 p99 max steady_rmse steady_p95 steady_max transient_rmse transient_max ultimate ultimate_bound"
_UNITS = (
    (_DISTANCES, "cm", 100.0),
    ("settling_time time_of_max ended", "s", 1.0),
    ("body_rate_rms steady_body_rate_rms", "rad/s", 1.0),
    ("thrust_mean", "N", 1.0),
    ("mass mass_estimate", "kg", 1.0),
    ("disturbance_estimate.0 disturbance_estimate.1 disturbance_estimate.2", "m/s²", 1.0),
)
_UNIT_OF = {name: (f", {unit}", factor) for names, unit, factor in _UNITS for name in names.split()}


def _unit_of(column: str) -> tuple[str, float]:
    return _UNIT_OF.get(re.sub(r"^phase\d+_", "", column), ("", 1.0))


def _rows(results: Sweep | str | os.PathLike[str], column: str) -> tuple[pandas.DataFrame, list[str]]:
    """Return the rows of flights, and the names of the laws in the order of the sweep."""
    sweep = results if isinstance(results, Sweep) else Sweep(results)
    rows = sweep.to_pandas()
    if column not in rows or rows[column].dtype.kind != "f":
        numbers = (str(name) for name in rows if rows[name].dtype.kind == "f")
        raise KeyError(f"there is no result {column!r}; there are {', '.join(numbers)}")
    return rows[rows["outcome"] != "refused"], [law.name for law in sweep.summary.laws]


def distribution(results: Sweep | str | os.PathLike[str], axes: Axes, column: str = "steady_rmse") -> None:
    """Draw the share of flights below a value for each law; a lost flight is below no value."""
    unit, factor = _unit_of(column)
    rows, laws = _rows(results, column)
    for index, law in enumerate(laws):
        flown = rows[rows["law"] == law]
        values = flown.loc[flown["outcome"] == "completed", column].dropna().sort_values()
        shares = [(rank + 1) / len(flown) for rank in range(len(values))]
        label = f"{law} ({len(values)} of {len(flown)} flights)"
        axes.step(factor * values, shares, where="post", label=label, color=_COLORS[index % len(_COLORS)])
    axes.set_xlabel(f"{column}{unit}")
    axes.set_ylabel("share of the flights below")
    axes.set_ylim(0.0, 1.0)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)


def differences(
    results: Sweep | str | os.PathLike[str], axes: Axes, column: str = "steady_rmse", reference: str | None = None
) -> None:
    """Draw the differences from a reference law [default: the first] in samples that both laws completed.

    Boxes are quartiles, whiskers 5 and 95 %; each law is labelled with its number of pairs, and the numbers of flights
    that only it and only the reference did not survive.
    """
    unit, factor = _unit_of(column)
    rows, laws = _rows(results, column)
    reference = reference if reference is not None else laws[0]
    if reference not in laws or len(laws) < 2:
        raise KeyError(f"there is nothing to compare with {reference!r}; the laws are {', '.join(map(repr, laws))}")
    values = rows.pivot_table(index="sample", columns="law", values=column, dropna=False).reindex(columns=laws)
    completed = rows.assign(is_completed=rows["outcome"] == "completed")
    completed = completed.pivot(index="sample", columns="law", values="is_completed").reindex(columns=laws)
    others = [law for law in laws if law != reference]
    boxes, names = [], []
    for law in others:
        pair = completed[[law, reference]].dropna().astype(bool)
        both = pair.index[pair.all(axis=1)]
        boxes.append((factor * (values.loc[both, law] - values.loc[both, reference])).dropna().to_numpy())
        alone = [int((~pair[one] & pair[other]).sum()) for one, other in ((law, reference), (reference, law))]
        names.append(f"{law}\n{len(boxes[-1])} pairs; lost alone {alone[0]}, {alone[1]}")
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    drawn = axes.boxplot(boxes, whis=(5.0, 95.0), sym=".", patch_artist=True, tick_labels=names)
    for law, box in zip(others, drawn["boxes"]):
        box.set_facecolor(_COLORS[laws.index(law) % len(_COLORS)])
        box.set_alpha(0.5)
    for line in drawn["medians"]:
        line.set_color("black")
    axes.set_ylabel(f"{column},\ndifference from {reference}{unit}")


def save(
    results: Sweep | str | os.PathLike[str], folder: str | os.PathLike[str], column: str = "steady_rmse"
) -> list[Path]:
    """Write the figures of a sweep into a folder, as SVG and PDF; return the files. Differences need two laws."""
    from matplotlib.figure import Figure

    sweep = results if isinstance(results, Sweep) else Sweep(results)
    drawings = [distribution] if len(sweep.summary.laws) < 2 else [distribution, differences]
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    # A column may be a key of the scenario, with any character.
    name = re.sub(r"[^\w.+-]+", "_", column)
    # Embedded TrueType fonts, as publishers require, and reproducible bytes.
    with matplotlib.rc_context({"pdf.fonttype": 42, "svg.hashsalt": "gerono", "font.size": 9.0}):
        for draw in drawings:
            width = 3.5 if draw is distribution else max(3.5, 1.75 * (len(sweep.summary.laws) - 1))
            figure = Figure(figsize=(width, 2.6), layout="constrained")
            draw(sweep, figure.subplots(), column)
            for form, date in (("svg", "Date"), ("pdf", "CreationDate")):
                files.append(folder / f"{draw.__name__}-{name}.{form}")
                figure.savefig(files[-1], metadata={date: None})
    return files


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the figures of a sweep; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m gerono.figures", description=__doc__.split("\n", 1)[0])
    parser.add_argument("results", type=Path, help="folder of a sweep, with results.parquet and sweep.json")
    parser.add_argument("--column", default="steady_rmse", help="result to draw [default: steady_rmse]")
    parser.add_argument("--out", type=Path, help="folder for the figures [default: that of the results]")
    chosen = parser.parse_args(arguments)
    try:
        files = save(chosen.results, chosen.out or chosen.results, chosen.column)
    except (OSError, KeyError) as error:
        print(f"python -m gerono.figures: {error.args[0] if isinstance(error, KeyError) else error}", file=sys.stderr)
        return 2
    print("\n".join(map(str, files)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
