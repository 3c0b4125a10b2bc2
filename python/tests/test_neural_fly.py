"""The comparison with Neural-Fly's recordings, tried on recordings of its form: theirs may not be shipped."""

import math
import subprocess
import sys

import gerono
from conftest import REPOSITORY

COMPARE = REPOSITORY / "examples" / "neural_fly" / "compare.py"


def record(clone, method, condition, error, transient):
    """Write 50 s at 50 Hz: a distance of `transient` before the 12th second, and of `error` after it."""
    folder = clone / "data" / "experiment"
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["t,p,p_d,v"]
    for step in range(2500):
        t = 100.0 + step / 50
        wanted = [1.25 * math.sin(t), 0.0, 0.75 * math.sin(2 * t)]
        away = transient if t < 112.0 else error
        lines.append(f'{t},"{[wanted[0], away, wanted[2]]}","{wanted}","[0.0, 0.0, 0.0]"')
    (folder / f"custom_figure8_{method}_{condition}.csv").write_text("\n".join(lines) + "\n")


def compare(*arguments):
    return subprocess.run([sys.executable, COMPARE, *arguments], capture_output=True, text=True, timeout=120)


def test_errors_are_those_after_the_transient(tmp_path):
    record(tmp_path, "baseline", "nowind", 0.1, 0.5)
    record(tmp_path, "NF-C", "100wind", 0.05, 0.5)
    record(tmp_path, "NF-C", "70p20sint", 1.0, 1.0)  # of no steady wind
    lines = compare(tmp_path).stdout.splitlines()
    assert lines[1].split() == ["NF-C", "–", "–", "–", "5.00", "cm"]
    assert lines[2].split() == ["baseline", "10.00", "–", "–", "–", "cm"]
    assert len(lines) == 3


def test_a_sweep_stands_beside_them(tmp_path):
    record(tmp_path, "INDI", "nowind", 0.07, 0.5)
    scenario = gerono.Scenario(REPOSITORY / "scenarios" / "neural_fly.toml")
    vary = {"wind": gerono.choice(0.0), "vehicle.wind.mean": ["-wind", 0.0, 0.0]}
    flown = gerono.sweep(
        scenario, vary, method="grid", set={"duration": 13.0}, compare={"indi": {"controller.law": "indi"}}, folder=tmp_path / "sweep"
    )
    expected = flown.to_pandas()["phase2_rmse"].iloc[0]
    lines = compare(tmp_path, flown.folder).stdout.splitlines()
    assert lines[-1].split()[:2] == ["indi", f"{100 * expected:.2f}"]


def test_a_wrong_folder_is_refused(tmp_path):
    refused = compare(tmp_path)
    assert refused.returncode == 1
    assert "clone of their repository" in refused.stderr
