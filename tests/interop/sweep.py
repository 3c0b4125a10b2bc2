"""Reads the table of a sweep with pandas, polars and DuckDB, and compares it with the rows of the shard and with the summary.

    sweep.py GERONO SWEEP.toml FOLDER

* Each of the three finds the columns with their types, and in them what the shard's file says, to the last bit.
* The texts about the table are the sweep and its scenario.
* Counts, rates, quantiles and paired differences of the summary are those that pandas computes of the table.

Results go to FOLDER. Fails at the first difference, naming it.
"""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import duckdb
import numpy as np
import pandas
import polars
import pyarrow.parquet
from check import Difference, require

ROWS_OF_A_GROUP = 8192

# How each reader calls the types: whole numbers, numbers, texts, flags. Those of pandas that may be missing are objects.
PANDAS = {"int64": int, "float64": float, "str": str, "bool": bool, "object": bool}
POLARS = {polars.Int64: int, polars.Float64: float, polars.String: str, polars.Boolean: bool}
DUCKDB = {"BIGINT": int, "DOUBLE": float, "VARCHAR": str, "BOOLEAN": bool}

SHARES = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0]
TOLERANCE = 1e-12


def rows_of(shard):
    """Names of the columns, and the rows of a complete shard's file: JSON between a header and a footer, each after its checksum."""
    header, *rows, footer = shard.read_text(encoding="utf-8").splitlines()
    require(json.loads(footer)["rows"] == len(rows), f"{shard.name} has {len(rows)} rows, its footer says {footer}")
    return json.loads(header)["columns"], [row for _, row in map(json.loads, rows)]


def with_pandas(path):
    """Columns by name, each a type and a list, by pandas."""
    frame = pandas.read_parquet(path)
    columns = {}
    for name, column in frame.items():
        values = column.tolist()
        kind = PANDAS[str(column.dtype)]
        columns[name] = kind, [None if value != value else value for value in values] if kind is float else values
    return columns


def with_polars(path):
    """The same by polars."""
    return {column.name: (POLARS[column.dtype], column.to_list()) for column in polars.read_parquet(path)}


def with_duckdb(path):
    """The same by DuckDB."""
    table = duckdb.read_parquet(str(path))
    values = zip(*table.fetchall(), strict=True)
    return {
        name: (DUCKDB[str(kind)], list(column))
        for name, kind, column in zip(table.columns, table.types, values, strict=True)
    }


def types_of(names, rows):
    """The type of each column as the shard's rows show it; texts are never missing."""
    kinds = {}
    for name, values in zip(names, zip(*rows, strict=True), strict=True):
        found = {type(value) for value in values if value is not None}
        require(len(found) <= 1, f"{name}: {found} in the rows")
        kinds[name] = found.pop() if found else float
    return kinds


def compare(reader, columns, names, rows):
    """Compares what a reader finds with the shard's rows."""
    require(list(columns) == names, f"{reader}: the columns are {list(columns)}, not {names}")
    kinds = types_of(names, rows)
    for name, expected in zip(names, zip(*rows, strict=True), strict=True):
        kind, found = columns[name]
        require(kind is kinds[name], f"{reader}: {name} is {kind}, not {kinds[name]}")
        require(len(found) == len(expected), f"{reader}: {len(found)} rows of {name}, not {len(expected)}")
        for row, pair in enumerate(zip(found, expected, strict=True)):
            require(pair[0] == pair[1], f"{reader}: {name} of row {row} is {pair[0]}, not {pair[1]}")


def is_near(found, stated):
    """Whether a number is the summary's, but for rounding."""
    return bool(np.isclose(found, stated, rtol=TOLERANCE, atol=TOLERANCE))


def check_summary(frame, report):
    """Compares the summary with what pandas computes of the table."""
    require(report["samples"] == frame["sample"].nunique(), f"{report['samples']} samples")
    laws = {law["name"]: frame[frame["law"] == law["name"]].set_index("sample") for law in report["laws"]}
    require(list(frame["law"].unique()) == list(laws), f"the laws are {frame['law'].unique()}")
    for law in report["laws"]:
        check_law(law, laws[law["name"]])
    for difference in report["differences"]:
        mine, other = (laws[difference[key]] for key in ("law", "reference"))
        check_difference(difference, mine, other)


def check_law(law, rows):
    """Compares what the summary says of a law."""
    name, outcomes = law["name"], rows["outcome"].value_counts()
    for outcome in ("completed", "lost", "failed", "refused"):
        require(law[outcome] == outcomes.get(outcome, 0), f"{name}: {outcomes} in the table, {outcome} {law[outcome]}")
    flown = rows[rows["outcome"] != "refused"]
    for criterion in law["criteria"]:
        met = int(flown[criterion["name"]].sum())
        require((met, len(flown)) == (criterion["met"], criterion["flown"]), f"{name}: {met} of {len(flown)}, not {criterion}")
        require(is_near(met / len(flown), criterion["rate"]), f"{name}: {criterion}")
    completed = rows[rows["outcome"] == "completed"]
    for stated in law["quantiles"]:
        values = completed[stated["name"]].dropna()
        found = values.quantile(SHARES).to_numpy()
        require(len(values) == stated["count"], f"{name}: {len(values)} values, not {stated}")
        require(all(map(is_near, found, stated["values"])), f"{name}: quantiles {found}, not {stated}")


def check_difference(stated, mine, other):
    """Compares a paired difference."""
    completed = (mine["outcome"] == "completed") & (other["outcome"] == "completed")
    differences = (mine[stated["name"]] - other[stated["name"]])[completed].dropna()
    signs = [int((differences < 0).sum()), int((differences > 0).sum()), int((differences == 0).sum())]
    found = {"pairs": len(differences), "median": differences.median(), "mean": differences.mean()}
    found |= dict(zip(("won", "lost", "tied"), signs, strict=True))
    for name, value in found.items():
        require(is_near(value, stated[name]), f"{stated['law']}, {stated['name']}: {name} is {value}, not {stated[name]}")
    low, high = stated["interval"]
    require(low <= stated["median"] <= high, f"the median is outside of its interval: {stated}")


def main(gerono, sweep, folder):
    """Runs all checks."""
    subprocess.run([gerono, "sweep", "run", sweep, "--out", folder], check=True, stdout=subprocess.DEVNULL)
    table = folder / "results.parquet"
    names, rows = rows_of(folder / "shard-00000-of-00001.rows")
    groups = -(-len(rows) // ROWS_OF_A_GROUP)
    about = pyarrow.parquet.read_metadata(table)
    require(groups > 1 and about.num_row_groups == groups, f"{about.num_row_groups} row groups for {len(rows)} rows")
    texts = pyarrow.parquet.read_schema(table).metadata
    require(texts[b"gerono.sweep"] == sweep.read_bytes(), "the table has another sweep than the file's")
    scenario = sweep.parent / tomllib.loads(sweep.read_text(encoding="utf-8"))["scenario"]
    require(texts[b"gerono.scenario"] == scenario.read_bytes(), "the table has another scenario than the file's")
    require(set(types_of(names, rows).values()) == {int, float, str, bool}, "not every kind of column is tried")
    for reader in (with_pandas, with_polars, with_duckdb):
        compare(reader.__name__, reader(table), names, rows)
        print(f"{reader.__name__}: {len(rows)} rows of {len(names)} columns, types and values are those of the shard")
    report = json.loads((folder / "sweep.json").read_text(encoding="utf-8"))
    frame = pandas.read_parquet(table)
    require({"completed", "lost", "refused"} <= set(frame["outcome"]), f"only {set(frame['outcome'])} are tried")
    check_summary(frame, report)
    print("sweep: counts, rates, quantiles and differences of the summary are those that pandas computes")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    try:
        main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
    except Difference as difference:
        sys.exit(f"not equal: {difference}")
