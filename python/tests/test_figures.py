"""Figures of a sweep show its rows."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from conftest import REPOSITORY, SHORT
from matplotlib.figure import Figure

import gerono
from gerono import figures

# A wind that a part of the vehicles does not withstand.
WINDY = {"vehicle.wind.mean": [gerono.uniform(0.0, 60.0), 0.0, 0.0]}


@pytest.fixture(scope="module")
def flown(fig1, tmp_path_factory):
    compare = {"paper": None, "stiff": {"controller.k1": 8.0}, "soft": {"controller.k1": 1.0}}
    setting = SHORT | {"duration": 4.0, "vehicle.drag": [0.1, 0.1, 0.05], "judge.distance_max": 1.0, "judge.steady_after": 1.0}
    folder = tmp_path_factory.mktemp("sweep")
    return gerono.sweep(fig1, WINDY, samples=24, set=setting, compare=compare, folder=folder)


def test_a_distribution_counts_lost_flights_as_flown(flown):
    axes = Figure().subplots()
    figures.distribution(flown, axes)
    rows = flown.to_pandas()
    for line, (law, of_law) in zip(axes.get_lines(), rows.groupby("law", sort=False), strict=True):
        completed = of_law[of_law["outcome"] == "completed"]
        assert 0 < len(completed) < len(of_law) == 24
        assert line.get_label() == f"{law} ({len(completed)} of 24 flights)"
        np.testing.assert_allclose(line.get_xdata(), np.sort(100.0 * completed["steady_rmse"]))
        assert line.get_ydata()[-1] == len(completed) / 24
    assert axes.get_xlabel() == "steady_rmse, cm"


@pytest.mark.parametrize(
    ("column", "label"),
    [
        ("phase2_steady_rmse", ", cm"),
        ("phase2_settling_time", ", s"),
        ("ended", ", s"),
        ("body_rate_rms", ", rad/s"),
        ("mass_estimate", ", kg"),
        ("disturbance_estimate.1", ", m/s²"),
        ("energy", ""),
        ("vehicle.mass", ""),
        ("cameras.attitude_deviation", ""),
        ("vehicle.turbulence.deviation", ""),
        ("vehicle.actuators.thrust_max", ""),
        ("controller.mass_max", ""),
        ("controller.lambda_mass", ""),
    ],
)
def test_only_results_have_units_by_their_names(column, label):
    assert figures._unit_of(column) == (label, 100.0 if label == ", cm" else 1.0)


def test_all_results_of_length_are_drawn_in_centimetres(flown):
    lengths = {name for name in flown.to_pandas() if figures._unit_of(name)[1] == 100.0}
    table = (REPOSITORY / "docs" / "sweeps.md").read_text().split("## Rows")[1].split("## What is said")[0]
    assert len(lengths) == 14
    assert all(f"`{name}`" in table for name in lengths)


@pytest.fixture(scope="module")
def refused(fig1, tmp_path_factory):
    """The first sample of the first law is refused, because its bound is above the estimate with which it begins."""
    vary = {"controller.initial.mass": gerono.uniform(0.19, 0.21), KEY: gerono.choice(0.001, 0.002)}
    compare = {"first": {"controller.bounds.mass_min": 0.2}, "second": None}
    folder = tmp_path_factory.mktemp("refused")
    runs = gerono.sweep(fig1, vary, samples=6, set=SHORT, compare=compare, folder=folder)
    outcomes = runs.to_pandas().query("law == 'first'")["outcome"].tolist()
    assert outcomes[0] == "refused"
    assert "completed" in outcomes
    return runs


KEY = 'schedule.latency."rc/frame -> plant"'


def test_the_first_law_comes_first_also_where_its_first_sample_is_refused(refused):
    axes = Figure().subplots()
    figures.distribution(refused, axes)
    assert [line.get_label().split()[0] for line in axes.get_lines()] == ["first", "second"]
    axes = Figure().subplots()
    figures.differences(refused, axes)
    assert axes.get_ylabel() == "steady_rmse,\ndifference from first, cm"


def test_files_have_names_without_slashes(refused, tmp_path):
    files = figures.save(refused, tmp_path, KEY)
    assert files[0] == tmp_path / "distribution-schedule.latency._rc_frame_-_plant_.svg"
    assert set(tmp_path.iterdir()) == set(files)


def test_differences_are_those_of_the_summary(flown):
    axes = Figure().subplots()
    figures.differences(flown, axes)
    rows = flown.to_pandas().pivot(index="sample", columns="law", values=["steady_rmse", "outcome"])
    medians = [line.get_ydata()[0] for line in axes.get_lines() if line.get_color() == "black" and len(set(line.get_ydata())) == 1]
    stated = [entry for entry in flown.summary.differences if entry.name == "steady_rmse"]
    assert [entry.law for entry in stated] == ["stiff", "soft"]
    for entry, label in zip(stated, axes.get_xticklabels(), strict=True):
        alone = f"lost alone {entry.only_law_failed}, {entry.only_reference_failed}"
        assert label.get_text() == f"{entry.law}\n{entry.pairs} pairs; {alone}"
        both = (rows["outcome"][[entry.law, "paper"]] == "completed").all(axis=1)
        difference = 100.0 * (rows["steady_rmse"][entry.law] - rows["steady_rmse"]["paper"])[both].astype(float)
        assert any(np.isclose(median, difference.median()) for median in medians)
        assert np.isclose(difference.median(), 100.0 * entry.median)


def test_files_are_vector_graphics_with_fonts_and_the_same_bytes_each_time(flown, tmp_path):
    files = figures.save(flown, tmp_path / "one")
    again = figures.save(flown.folder, tmp_path / "two")
    assert [file.name for file in files] == [
        f"{name}-steady_rmse.{form}" for name in ("distribution", "differences") for form in ("svg", "pdf")
    ]
    for one, other in zip(files, again, strict=True):
        content = one.read_bytes()
        assert content == other.read_bytes()
        if one.suffix == ".svg":
            assert ElementTree.fromstring(content).tag.endswith("svg")
        else:
            assert content.startswith(b"%PDF-")
            assert b"/FontFile2" in content


def test_the_command_says_what_is_missing(flown, tmp_path, capsys):
    assert figures.main([str(flown.folder), "--out", str(tmp_path)]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 4
    assert figures.main([str(tmp_path / "nothing")]) == 2
    assert "sweep.json" in capsys.readouterr().err
    assert figures.main([str(flown.folder), "--column", "outcome"]) == 2
    assert "there is no result 'outcome'" in capsys.readouterr().err
    with pytest.raises(KeyError, match="'pid'"):
        figures.differences(flown, Figure().subplots(), reference="pid")
