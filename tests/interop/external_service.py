"""Flies the controller in Python in place of Gerono's own.

    external_service.py GERONO FOLDER

* In simulated time two flights have the same bytes and end at the point; a replay does the steps of the services beside it again.
* Services that die beside it are restarted, and the log shows nothing of it.
* In real time it ends at the point, too; so it does after it was killed on the way, as another process.

Results go to FOLDER. Fails at the first that is otherwise, naming it.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from check import Difference, require

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/python_controller"

# Largest distance from the point in the last 5 s, m, as the example's README says.
IN_SIMULATED_TIME = 0.001
IN_REAL_TIME = 0.005


def command(gerono, out, *more):
    """The command that flies the example to a folder."""
    python = f'programs.controller=["{sys.executable}", "controller.py"]'
    return [gerono, "run", str(EXAMPLE / "hover.toml"), "--set", python, "--quiet", "--out", str(out), *more]


def fly(*arguments):
    """Flies, and must succeed."""
    require(subprocess.run(command(*arguments), check=False).returncode == 0, f"the flight {arguments[1]} failed")


def require_arrival(out, limit):
    """The flight has ended at the point; returns how far off, m."""
    summary = json.loads((out / "summary.json").read_text())
    [phase] = summary["phases"]
    require(phase["is_complete"] and phase["ultimate"] < limit, f"{out.name}: {phase['ultimate']} m from the point at the end")
    return phase["ultimate"]


def check_simulated_time(gerono, folder):
    """Simulated time; returns the distance from the point."""
    first = folder / "first"
    fly(gerono, first)
    fly(gerono, folder / "second")
    crashes = ("--crash", "path_generator@1000:after-step", "--crash", "rc_output@2000:before-step")
    fly(gerono, folder / "with-deaths", *crashes)
    log = (first / "run.mcap").read_bytes()
    for other in ("second", "with-deaths"):
        require((folder / other / "run.mcap").read_bytes() == log, f"the flight {other} has other bytes than the first")
    replay = subprocess.run([gerono, "replay", str(first), "--quiet"], capture_output=True, text=True, check=False)
    require(replay.returncode == 0 and "controller cannot be computed again" in replay.stdout, f"the replay: {replay.stdout}{replay.stderr}")
    return require_arrival(first, IN_SIMULATED_TIME)


def controller_of(run):
    """The process of the controller of a run, if there is one."""
    children = Path(f"/proc/{run}/task/{run}/children").read_text().split()
    lines = ((int(child), Path(f"/proc/{child}/cmdline")) for child in children)
    return next((child for child, line in lines if line.exists() and b"controller.py" in line.read_bytes()), None)


def check_real_time(gerono, folder):
    """Real time; returns the distance from the point, without a death and with one."""
    calm, disturbed = folder / "real-time", folder / "real-time-death"
    fly(gerono, calm, "--host", "realtime")
    with subprocess.Popen(command(gerono, disturbed, "--host", "realtime")) as run:
        time.sleep(2)
        external = controller_of(run.pid)
        require(external is not None, "the controller has no process 2 s after the start")
        os.kill(external, signal.SIGKILL)
        require(run.wait() == 0, "the flight in which the controller is killed failed")
    restarts = json.loads((disturbed / "summary.json").read_text())["rebirths"]
    require([restart["service"] for restart in restarts] == ["controller"], f"these were restarted: {restarts}")
    return require_arrival(calm, IN_REAL_TIME), require_arrival(disturbed, IN_REAL_TIME)


def main(gerono, folder):
    """Runs all checks."""
    simulated = check_simulated_time(gerono, folder)
    calm, disturbed = check_real_time(gerono, folder)
    print(
        f"external: the controller in Python ends {1e3 * simulated:.2f} mm from its point in simulated time, with the same bytes each time; "
        f"in real time {1e3 * calm:.2f} mm, and {1e3 * disturbed:.2f} mm after a death on the way"
    )


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    try:
        main(sys.argv[1], Path(sys.argv[2]))
    except Difference as difference:
        sys.exit(f"not so: {difference}")
