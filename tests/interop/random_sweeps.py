"""Flies random sweeps, broken off and gone on with at random, and compares every cell with computations of its own.

    random_sweeps.py GERONO SCENARIO.toml COUNT SEED FOLDER

* pandas, polars and DuckDB find the same rows, those that the shards hold, to the last bit.
* Values that follow from others, conditions and criteria are what Python computes of the drawn values and of the results; drawn
  values are within their bounds.
* A sweep in parts, killed and gone on with, has the bytes of one that was flown at once.
* Counts, rates, quantiles and paired differences of the summary are those that pandas computes.

Fails at the first difference, naming the sweep, which stays in FOLDER.
"""

import json
import math
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas
from check import Difference, require
from sweep import check_summary, compare, rows_of, with_duckdb, with_pandas, with_polars

# Names that a table, a page or a shell could stumble over; an expression can use only those that are identifiers.
LAW_NAMES = ["as it is", "slow, k₁ = 2", "(2)", "k=2.5_a", "a.b-c", "Ω", "law"]
OWN_NAMES = ["m", "rho", "x_1", "täuschung", "_z", "select", "lambda_2"]


def number(draw, low, high):
    """A random number with few digits, so that what is written is what is meant."""
    return round(draw.uniform(low, high), 3)


def distribution(draw, low, high):
    """A random distribution between two positive bounds, in TOML, with the bounds of what it draws."""
    a, b = sorted([number(draw, low, high), number(draw, low, high)])
    b = b if b > a else round(a + 0.001, 3)
    kind = draw.choice(["uniform", "log_uniform", "normal", "choice"])
    if kind == "normal":
        return f"{{ normal = [{a}, {round(b - a, 3)}], min = {low}, max = {high} }}", (low, high)
    if kind == "choice":
        return f"{{ choice = [{a}, {b}, {b}] }}", (a, b)
    return f"{{ {kind} = [{a}, {b}] }}", (a, b)


class RandomSweep:
    """A sweep's text, and what Python makes of its values."""

    def __init__(self, seed, scenario):
        draw = random.Random(seed)
        own = draw.sample(OWN_NAMES, 2)
        first, second = own
        mass, bounds = distribution(draw, 0.14, 0.28)
        push, pushes = distribution(draw, 0.01, 0.9)
        factor = number(draw, 0.5, 3.0)
        limit = number(draw, 0.05, 0.9)
        near, far = sorted([number(draw, 0.1, 3.0), number(draw, 0.1, 3.0)])
        self.samples = draw.randint(1, 24)
        self.bounds = {first: bounds, second: pushes}
        # Of each derived column its value by the values of the row.
        self.derived = {
            "vehicle.mass": lambda row: row[first],
            "vehicle.disturbance.0": lambda row: factor * row[second] ** 2 - row[first] / 2,
            "vehicle.disturbance.1": lambda row: max(row[second], 0.2) * abs(row[first] - 0.2),
        }
        self.is_wanted = lambda row: row[second] < limit or row[first] > 0.2
        # Of each criterion its value by the results of a row; `None` where a result is missing.
        self.criteria = {
            "near": lambda row: None if row["max"] is None else near < row["max"] < far,
            "lives_or_not": lambda row: (row["lost"] and row["ended"] > 0.2) or row["survived"],
            "light": lambda row: None if row["rmse"] is None else row[first] < 0.2 and row["rmse"] * 2 <= far,
        }
        names = draw.sample(LAW_NAMES, draw.randint(1, 3))
        gains = ["", f"set = ['controller.k1={number(draw, 0.5, 6.0)}']", "set = ['path.mode=\"trajectory_tracking\"']"]
        compared = "".join(f"\n[[compare]]\nname = {json.dumps(name, ensure_ascii=False)}\n{gain}\n" for name, gain in zip(names, gains))
        away = draw.choice(["0.5", "5.0"])
        self.text = f"""scenario = {json.dumps(str(scenario))}
samples = {self.samples}
seed = {draw.randint(0, 2**31)}
method = "{draw.choice(["random", "random", "sobol", "latin"])}"
set = ["duration={draw.choice(["0.4", "0.9", "1.5"])}", "vehicle.change=[]", "judge.distance_max={away}"]
require = ['{second} < {limit} or {first} > 0.2']

[vary]
{json.dumps(first, ensure_ascii=False)} = {mass}
{json.dumps(second, ensure_ascii=False)} = {push}
"vehicle.mass" = '{first}'
"controller.lambda_inertia" = {{ choice = [1e-10, 1e-10, 1e-6] }}
"vehicle.disturbance" = ['{factor} * {second}^2 - {first} / 2', 'max({second}, 0.2) * abs({first} - 0.2)', 0.0]

[judge]
near = '{near} < max < {far}'
lives_or_not = '(lost and ended > 0.2) or survived'
light = '{first} < 0.2 and rmse * 2 <= {far}'
{compared}"""
        self.parts = draw.randint(1, 4)
        self.kills = draw.randint(0, 2)
        self.draw = draw


def run(*command):
    """Runs a command of which success is expected."""
    ended = subprocess.run(command, capture_output=True, text=True)
    require(ended.returncode == 0, f"{command}: {ended.returncode}, {ended.stderr}")
    return ended.stdout


def fly_in_parts(gerono, sweep, file, folder):
    """Flies the parts one after the other, some of them killed at a random time, and merges them."""
    for part in range(sweep.parts):
        command = [gerono, "sweep", "run", file, "--out", folder, "--shard", f"{part}/{sweep.parts}"]
        for _ in range(sweep.kills):
            flying = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(sweep.draw.uniform(0.0, 0.12))
            flying.send_signal(sweep.draw.choice([signal.SIGKILL, signal.SIGINT]))
            flying.wait()
        run(*command)
    run(gerono, "sweep", "merge", folder)


def check_row(sweep, row):
    """Compares a row with what Python computes."""
    for name, (low, high) in sweep.bounds.items():
        require(low <= row[name] <= high, f"{name} is {row[name]}, not within {low} and {high}")
    for name, compute in sweep.derived.items():
        expected = compute(row)
        require(math.isclose(row[name], expected, rel_tol=1e-14, abs_tol=1e-15), f"{name} is {row[name]}, not {expected}")
    is_refused = row["outcome"] == "refused"
    require(is_refused == (not sweep.is_wanted(row)), f"sample {row['sample']} is {row['outcome']}")
    for name, compute in sweep.criteria.items():
        expected = None if is_refused else compute(row)
        if row["outcome"] in ("lost", "failed") and name != "lives_or_not":
            expected = False
        require(row[name] is expected, f"sample {row['sample']}, {row['law']}: {name} is {row[name]}, not {expected}")
    require(row["survived"] is (None if is_refused else row["outcome"] == "completed"), f"survived: {row}")


def check(gerono, seed, scenario, folder):
    """Flies a sweep at once and in parts, and compares. Returns the number of cells, and which outcomes there were."""
    sweep = RandomSweep(seed, scenario)
    folder.mkdir(parents=True)
    file = folder / "sweep.toml"
    file.write_text(sweep.text, encoding="utf-8")
    whole, parts = folder / "whole", folder / "parts"
    first = subprocess.run([gerono, "sweep", "run", file, "--out", whole], capture_output=True, text=True)
    if first.returncode == 2 and f"none of the {sweep.samples} samples can be flown" in " ".join(first.stderr.split()):
        return 0, {"refused"}
    require(first.returncode == 0, first.stderr)
    fly_in_parts(gerono, sweep, file, parts)
    for name in ("results.parquet", "sweep.json", "sweep.md"):
        require((whole / name).read_bytes() == (parts / name).read_bytes(), f"{name} differs")
    names, rows = rows_of(whole / "shard-00000-of-00001.rows")
    for reader in (with_pandas, with_polars, with_duckdb):
        compare(reader.__name__, reader(whole / "results.parquet"), names, rows)
    named = [dict(zip(names, row, strict=True)) for row in rows]
    for row in named:
        check_row(sweep, row)
    check_summary(pandas.read_parquet(whole / "results.parquet"), json.loads((whole / "sweep.json").read_text(encoding="utf-8")))
    return len(names) * len(rows), {row["outcome"] for row in named}


def main(gerono, scenario, count, seed, folder):
    """Runs all sweeps."""
    cells, outcomes = 0, set()
    for number_of_sweep in range(count):
        here = folder / f"sweep-{seed + number_of_sweep}"
        try:
            more, found = check(gerono, seed + number_of_sweep, scenario.resolve(), here)
        except Difference as difference:
            raise Difference(f"{here}: {difference}") from difference
        cells, outcomes = cells + more, outcomes | found
        shutil.rmtree(here)
    require(outcomes >= {"completed", "lost", "refused"} or count < 30, f"only {outcomes} came up")
    print(f"{count} random sweeps, {cells} cells: no difference")


if __name__ == "__main__":
    if len(sys.argv) != 6:
        sys.exit(__doc__)
    try:
        main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), Path(sys.argv[5]))
    except Difference as difference:
        sys.exit(f"not equal: {difference}")
