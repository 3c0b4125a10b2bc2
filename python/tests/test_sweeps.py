"""Sweeps have the rows of the command."""

import subprocess

import controller
import pytest
from conftest import REPOSITORY, SHORT, ctrl_c

import gerono
from gerono.sweeps import sweep_text

VARY = {"vehicle.mass": gerono.uniform(0.18, 0.26), "controller.k1": gerono.choice(2.0, 4.0)}


def test_rows_are_those_of_the_command(fig1, command, tmp_path):
    runs = gerono.sweep(fig1, VARY, samples=20, set=SHORT, folder=tmp_path / "module")
    text = sweep_text(fig1, 20, 1, "random", VARY, None, None, (), SHORT, "none")
    (tmp_path / "sweep.toml").write_text(text)
    subprocess.run(
        [command, "sweep", "run", tmp_path / "sweep.toml", "--out", tmp_path / "command"], check=True, capture_output=True
    )
    ours, theirs = (gerono.Sweep(tmp_path / name).to_polars() for name in ("module", "command"))
    assert ours.equals(theirs)
    assert runs.rate().value == 1.0
    assert 0.8 < runs.rate().low < 1.0


def test_a_row_is_the_flight_of_its_values(fig1):
    runs = gerono.sweep(fig1, VARY, samples=3, set=SHORT, method="sobol")
    for row in runs.to_polars().iter_rows(named=True):
        values = {key: row[key] for key in VARY}
        assert fig1.fly(seed=row["seed"], set=SHORT | values).summary.metrics.rmse == row["rmse"]
    assert runs.rate().low is None


def test_laws_fly_the_same_samples():
    laboratory = gerono.Scenario(REPOSITORY / "scenarios" / "fig3_6.toml")
    compare = {"paper": None, "indi": {"controller.law": "indi"}}
    runs = gerono.sweep(laboratory, VARY, samples=4, set=SHORT, compare=compare)
    table = runs.to_pandas()
    assert list(table["law"].unique()) == ["paper", "indi"]
    paper, indi = (table[table["law"] == law]["vehicle.mass"].tolist() for law in ("paper", "indi"))
    assert paper == indi
    assert runs.rate(law="indi").flown == 4
    with pytest.raises(KeyError, match="paper, indi"):
        runs.rate(law="pid")


def test_ctrl_c_ends_a_sweep_and_keeps_its_rows(fig1, tmp_path):
    arguments = {"samples": 300, "set": SHORT | {"duration": 20.0}, "folder": tmp_path, "jobs": 1}

    def has_rows():
        return any(rows.read_text().count("\n") > 1 for rows in tmp_path.glob("*.rows.partial"))

    with ctrl_c(after=0.0, when=has_rows):
        gerono.sweep(fig1, VARY, **arguments)
    (rows,) = tmp_path.glob("*.rows.partial")
    kept = len(rows.read_text().splitlines()) - 1
    assert 0 < kept < 300
    assert len(gerono.sweep(fig1, VARY, **arguments).to_polars()) == 300


def test_deep_criteria_are_refused(fig1):
    deep = "(" * 200_000 + "1" + ")" * 200_000
    with pytest.raises(Exception, match="at most 100 deep"):
        gerono.sweep(fig1, VARY, samples=2, set=SHORT, judge={"deep": deep})


def test_a_class_is_swept(hover):
    vary = {"vehicle.mass": gerono.uniform(0.19, 0.21)}
    runs = gerono.sweep(hover, vary, samples=4, set={"duration": 3.0}, controller=controller.Hover)
    rows = runs.to_polars()
    assert len(rows) == 4
    row = rows.row(2, named=True)
    flight = hover.fly(row["seed"], {"duration": 3.0, "vehicle.mass": row["vehicle.mass"]}, controller.Hover())
    assert flight.summary.metrics.rmse == row["rmse"]


def test_what_is_wrong_is_said(fig1):
    with pytest.raises(gerono.ScenarioError, match="masss"):
        gerono.sweep(fig1, {"vehicle.masss": gerono.uniform(0.1, 0.2)}, samples=2)
    with pytest.raises(gerono.ScenarioError):
        gerono.sweep(fig1, {"vehicle.mass": gerono.uniform(0.2, 0.1)}, samples=2)

    def broken():
        raise LookupError("no controller")

    with pytest.raises(LookupError, match="no controller"):
        gerono.sweep(fig1, VARY, samples=2, set=SHORT, controller=broken)
