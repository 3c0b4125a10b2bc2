"""Neural-Fly's own recordings beside the same figure flown here; README.md beside it says more.

    python compare.py CLONE [SWEEP]
"""
import ast
import csv
import math
import sys
from pathlib import Path

import gerono

SETTLED = 12.0  # s: their errors are those of what comes after
WINDS = {"nowind": 0.0, "35wind": 4.2, "70wind": 8.5, "100wind": 12.1}  # m/s


def rms_error(recording):
    """Return the RMS of ‖p − p_d‖ after the first 12 s of a recording, m."""
    with open(recording, newline="") as file:
        rows = [(float(row["t"]), *map(ast.literal_eval, (row["p"], row["p_d"]))) for row in csv.DictReader(file)]
    begins = rows[0][0] + SETTLED
    squares = [math.dist(position, wanted) ** 2 for t, position, wanted in rows if t >= begins]
    return math.sqrt(sum(squares) / len(squares))


def recorded(clone):
    """Return the errors of the recordings of a clone, m, by method and wind."""
    folder = Path(clone) / "data" / "experiment"
    errors = {}
    for path in sorted(folder.glob("custom_figure8_*_*.csv")):
        method, condition = path.stem.removeprefix("custom_figure8_").rsplit("_", 1)
        if condition in WINDS:
            errors.setdefault(method, {})[WINDS[condition]] = rms_error(path)
    if not errors:
        sys.exit(f"there is no custom_figure8_METHOD_WIND.csv in {folder}: give the folder of a clone of their repository")
    return errors


def flown(folder):
    """Return the median errors of a sweep, m, by law and wind."""
    rows = gerono.Sweep(folder).to_pandas()
    medians = rows[rows["survived"]].groupby(["law", "wind"], sort=False)["phase2_rmse"].median()
    return {law: medians[law].to_dict() for law in rows["law"].unique()}


def table(title, errors):
    """Print errors in cm, one line a method."""
    print(f"{title:26}" + "".join(f"{wind:7.1f}" for wind in WINDS.values()) + "   m/s")
    for method, by_wind in errors.items():
        cells = (f"{100 * by_wind[wind]:7.2f}" if wind in by_wind else "      –" for wind in WINDS.values())
        print(f"{method:26}" + "".join(cells) + "   cm")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    table("their recordings", recorded(sys.argv[1]))
    if len(sys.argv) == 3:
        table("the sweep, median", flown(sys.argv[2]))
