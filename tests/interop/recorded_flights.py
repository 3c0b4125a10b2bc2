"""Imports PX4's recorded flight from its two formats, replays it, and compares the estimator with EKF2.

    recorded_flights.py GERONO SCENARIO DATA WORK

DATA is the folder of the crate `ekf2`; WORK has samples.csv and states.csv of the same flight as a ULog file.
"""

import json
import math
import subprocess
import sys
from pathlib import Path

# Time between which the two are compared, s: from when both have converged until before the landing.
COMPARED = ["--from", "10", "--to", "30"]
# Largest differences of a component: velocity (m/s), position (m), attitude (rad).
LIMITS = {"velocity": 0.1, "position": 0.3, "attitude": math.radians(1.0)}


def run(*arguments: object, code: int = 0) -> str:
    done = subprocess.run([str(argument) for argument in arguments], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done)
    return done.stdout + done.stderr


def main() -> None:
    gerono, scenario, data, work = sys.argv[1], *map(Path, sys.argv[2:])
    flights = [
        ("table of EKF2", data / "iris_gps_replay.csv", data / "iris_gps_reference.csv"),
        ("ULog", work / "samples.csv", work / "states.csv"),
    ]
    print("| largest difference from EKF2 of a component | velocity, m/s | position, m | attitude, ° |")
    print("| --- | --- | --- | --- |")
    for name, samples, reference in flights:
        out = work / f"run of {name}"
        found = json.loads(
            run(gerono, "import", samples, "--scenario", scenario, "--thin", "--reference", reference, *COMPARED, "--out", out, "--json")
        )
        lines = samples.read_text().splitlines()
        for kind, topic in [("imu", "imu/sample"), ("gps", "gnss/fix"), ("baro", "baro/altitude"), ("mag", "mag/field")]:
            recorded = sum(line.split(",")[1] == kind for line in lines)
            source = next(source for source in found["sources"] if source["topic"] == topic)
            assert source["samples"] + source["left_out"] == recorded, (kind, recorded, source)
            assert source["left_out"] == 0 or kind in ("baro", "mag"), source
        largest = {what: found["differences"][what]["largest"] for what in LIMITS}
        attitude = math.degrees(largest["attitude"])
        print(f"| PX4's recorded flight, {name} | {largest['velocity']:.2f} | {largest['position']:.2f} | {attitude:.1f} |")
        for what, limit in LIMITS.items():
            assert largest[what] <= limit, (name, what, largest[what], limit)

        # The estimator is repeated to the bit, and with other parameters it makes something else of the same samples.
        assert "identical" in run(gerono, "replay", out, "--service", "estimator", "--quiet")
        assert "external services" in run(gerono, "replay", out, "--quiet")
        changed = run(gerono, "replay", out, "--service", "estimator", "--quiet", "--set", "navigation.field_white=0.05")
        assert "not identical" in changed and "vehicle/state" in changed, changed
        # The commands on logs take it, and so does a comparison with the recording's own estimate.
        assert "gnss/fix" in run(gerono, "info", out)
        run(gerono, "report", out, out / "reference")
        run(gerono, "export", out, "--view", "--out", work / f"{name}.mcap")
        assert len(run(gerono, "export", out, "--csv", "--topic", "vehicle/state").splitlines()) > 8000
        assert "vehicle/state" in run(gerono, "diff", out, out / "reference", code=8)


main()
