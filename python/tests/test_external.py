"""The example's controller as a service of its own: in simulated time, in real time, with deaths."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

# Largest distance from the point in the last 5 s, m, as the example's README says.
IN_SIMULATED_TIME = 0.001
IN_REAL_TIME = 0.005


@pytest.fixture
def run(hover, command):
    """Returns the command that flies the example to a folder."""
    program = f'programs.controller=["{sys.executable}", "controller.py"]'
    return lambda out, *more: [command, "run", hover.path, "--set", program, "--quiet", "--out", out, *more]


def distance(out):
    """Returns the largest distance from the point at the end, m."""
    [phase] = json.loads((out / "summary.json").read_text())["phases"]
    assert phase["is_complete"]
    return phase["ultimate"]


def test_simulated_time_is_exact_whoever_dies(run, command, tmp_path):
    crashes = ("--crash", "path_generator@1000:after-step", "--crash", "rc_output@2000:before-step")
    for out, more in (("first", ()), ("second", ()), ("with-deaths", crashes)):
        subprocess.run(run(tmp_path / out, *more), check=True)
    log = (tmp_path / "first" / "run.mcap").read_bytes()
    assert all((tmp_path / other / "run.mcap").read_bytes() == log for other in ("second", "with-deaths"))
    assert distance(tmp_path / "first") < IN_SIMULATED_TIME
    replay = subprocess.run([command, "replay", tmp_path / "first", "--quiet"], capture_output=True, text=True)
    assert replay.returncode == 0, replay.stdout + replay.stderr
    assert "controller cannot be computed again" in replay.stdout


def test_it_flies_in_real_time(run, tmp_path):
    subprocess.run(run(tmp_path, "--host", "realtime"), check=True)
    assert distance(tmp_path) < IN_REAL_TIME


def controller_of(flight):
    """Returns the process of the controller of a flight, if there is one."""
    children = Path(f"/proc/{flight}/task/{flight}/children").read_text().split()
    lines = ((int(child), Path(f"/proc/{child}/cmdline")) for child in children)
    return next((child for child, line in lines if line.exists() and b"controller.py" in line.read_bytes()), None)


def test_a_successor_takes_over_in_real_time(run, tmp_path):
    with subprocess.Popen(run(tmp_path, "--host", "realtime")) as flight:
        time.sleep(2)  # any moment of the flight will do
        controller = controller_of(flight.pid)
        assert controller is not None
        os.kill(controller, signal.SIGKILL)
        assert flight.wait() == 0
    restarts = json.loads((tmp_path / "summary.json").read_text())["restarts"]
    assert [restart["service"] for restart in restarts] == ["controller"]
    assert distance(tmp_path) < IN_REAL_TIME
