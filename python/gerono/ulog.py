"""The samples of a PX4 log (ULog), as the tables that `gerono import` reads.

    python -m gerono.ulog flight.ulg samples.csv states.csv

writes the sensors' samples and the states of PX4's own estimator. The reader is PX4's, `pyulog` (`pip install pyulog`).
Nothing is left out silently: what is not used is printed, with its number.
"""

from __future__ import annotations

import importlib
import math
import sys
from collections import Counter
from pathlib import Path
from typing import Any

# PX4 projects on a sphere of this radius, m.
RADIUS = 6_371_000.0

# Accuracy of a velocity from which nothing follows, m/s.
UNKNOWN_VELOCITY = 100.0

# What PX4 calls RTK float and RTK fixed, as `gerono import` numbers them.
KINDS = {5: 1, 6: 2}


# A sample of a topic: its fields by name.
Row = dict[str, Any]


class Refused(Exception):
    """What is wrong with the log, and what to do about it."""


class Ulog:
    """A log with the samples of its topics by name."""

    def __init__(self, path: Path) -> None:
        try:
            # A package without types.
            reader = importlib.import_module("pyulog")
        except ImportError as error:
            raise Refused("the reader of PX4 is missing: pip install pyulog") from error
        try:
            self.log = reader.ULog(str(path))
        except Exception as error:  # pyulog raises what its parsing stumbles over
            raise Refused(f"{path} cannot be read: {error!r}") from error
        if self.log.file_corruption:
            raise Refused(f"{path} is damaged; `ulog_info {path}` says more")

    def rows(self, *names: str) -> list[Row]:
        """The samples of the first of these topics that the log has, of its first instance."""
        for name in names:
            found = [data for data in self.log.data_list if data.name == name and len(data.data["timestamp"])]
            if found:
                data = min(found, key=lambda data: data.multi_id).data
                count = len(data["timestamp"])
                return [{key: values[index].item() for key, values in data.items()} for index in range(count)]
        return []

    def needed(self, *names: str) -> list[Row]:
        rows = self.rows(*names)
        if not rows:
            raise Refused(f"the log has no samples of {' or '.join(names)}: log them (SDLOG_PROFILE, estimator replay)")
        return rows


def measured(row: Row) -> int:
    """The time of a measurement, µs."""
    time: int = row.get("timestamp_sample") or row["timestamp"]
    return time


def vector(row: Row, name: str, count: int = 3) -> list[float]:
    return [row[f"{name}[{index}]"] for index in range(count)]


def place(row: Row) -> tuple[float, float, float]:
    """Latitude and longitude in degrees, and the height above the sea in m, as old and new versions of PX4 have them."""
    if "latitude_deg" in row:
        return row["latitude_deg"], row["longitude_deg"], row["altitude_msl_m"]
    return row["lat"] * 1e-7, row["lon"] * 1e-7, row["alt"] * 1e-3


def table(log: Ulog) -> tuple[list[tuple[int, str, list[float]]], tuple[float, float, float], dict[str, int]]:
    """The lines in the order of time, the place of the first fix, and the number of lines that were left out, by their reason."""
    lines: list[tuple[int, str, list[float]]] = []
    left_out: Counter[str] = Counter()
    for row in log.needed("sensor_combined"):
        lines.append((row["timestamp"], "imu", vector(row, "accelerometer_m_s2") + vector(row, "gyro_rad")))
    for row in log.needed("vehicle_magnetometer"):
        lines.append((measured(row), "mag", vector(row, "magnetometer_ga")))
    for row in log.needed("vehicle_air_data"):
        lines.append((measured(row), "baro", [row["baro_alt_meter"]]))
    first = None
    for row in log.needed("vehicle_gps_position", "sensor_gps"):
        # 8 is extrapolated, and measures nothing.
        if not 3 <= row["fix_type"] <= 6:
            left_out["fixes without a position"] += 1
            continue
        latitude, longitude, height = place(row)
        first = first or (latitude, longitude, height)
        velocity = [row["vel_n_m_s"], row["vel_e_m_s"], row["vel_d_m_s"]]
        speed_accuracy = row["s_variance_m_s"]
        # Versions of PX4 before the flag have valid ones.
        if not row.get("vel_ned_valid", True):
            left_out["velocities of fixes, which are not valid"] += 1
            velocity, speed_accuracy = [0.0, 0.0, 0.0], UNKNOWN_VELOCITY
        reported = [float(KINDS.get(row["fix_type"], 0)), row["eph"], row["epv"], speed_accuracy]
        lines.append((row["timestamp"], "gps", [height * 1e3, longitude * 1e7, latitude * 1e7, *velocity, *reported]))
    if first is None:
        raise Refused("no fix of the log has a position")
    for row in log.needed("vehicle_land_detected"):
        lines.append((row["timestamp"], "landed", [float(bool(row["landed"]))]))
    for row in log.rows("actuator_armed"):
        lines.append((row["timestamp"], "armed", [float(bool(row["armed"]))]))
    lines.sort(key=lambda line: (line[1], line[0]))
    kept = lines[:1] + [line for before, line in zip(lines, lines[1:]) if line[:2] != before[:2]]
    if len(kept) < len(lines):
        left_out["samples of a time that was there already"] += len(lines) - len(kept)
    kept.sort(key=lambda line: line[0])
    return kept, first, left_out


def states(log: Ulog, first: tuple[float, float, float]) -> list[list[float]]:
    """PX4's estimate: time, quaternion, and velocity and position to the north, east and downwards of the first fix."""
    attitudes = log.rows("vehicle_attitude")
    rows: list[list[float]] = []
    index = 0
    for row in log.rows("vehicle_local_position"):
        if not (row["xy_global"] and row["z_global"] and row["v_xy_valid"] and row["v_z_valid"]):
            continue
        time = measured(row)
        while index + 1 < len(attitudes) and measured(attitudes[index + 1]) <= time:
            index += 1
        # Both are published after each step of the estimator.
        if not attitudes or measured(attitudes[index]) != time or (rows and rows[-1][0] >= time):
            continue
        north = math.radians(row["ref_lat"] - first[0]) * RADIUS
        east = math.radians(row["ref_lon"] - first[1]) * RADIUS * math.cos(math.radians(first[0]))
        position = [row["x"] + north, row["y"] + east, row["z"] - (row["ref_alt"] - first[2])]
        rows.append([time, *vector(attitudes[index], "q", 4), row["vx"], row["vy"], row["vz"], *position])
    return rows


def words(numbers: list[float]) -> str:
    return ",".join(repr(number) for number in numbers)


def convert(path: Path, samples: Path, reference: Path | None = None) -> str:
    """Writes the tables of a log. Returns what a user should know, as text."""
    log = Ulog(path)
    lines, first, left_out = table(log)
    samples.write_text("".join(f"{time},{kind},{words(numbers)}\n" for time, kind, numbers in lines))
    text = f"{samples}: {len(lines)} lines\n"
    if reference is not None:
        rows = states(log, first)
        if not rows:
            raise Refused("the log has no vehicle_local_position with vehicle_attitude at the same times: leave the states out")
        names = "Timestamp,qw,qx,qy,qz,vn,ve,vd,pn,pe,pd\n"
        reference.write_text(names + "".join(f"{words(row)}\n" for row in rows))
        text += f"{reference}: {len(rows)} rows\n"
    for reason, count in left_out.items():
        text += f"left out: {count} {reason}\n"
    dropouts = log.log.dropouts
    if dropouts:
        text += f"PX4 lost samples {len(dropouts)} times, for up to {max(dropout.duration for dropout in dropouts)} ms\n"
    delay = log.log.initial_parameters.get("EKF2_GPS_DELAY")
    text += "the first fix is the datum: [datum] " + ", ".join(
        f"{name} = {value!r}" for name, value in zip(("latitude", "longitude", "height"), first)
    )
    if delay is not None:
        text += f"\nEKF2_GPS_DELAY: schedule.latency.\"gnss/fix -> estimator\" = {delay / 1e3!r}"
    return text + "\n"


def main() -> int:
    arguments = [Path(argument) for argument in sys.argv[1:]]
    if len(arguments) not in (2, 3):
        print("usage: python -m gerono.ulog FLIGHT.ulg SAMPLES.csv [STATES.csv]", file=sys.stderr)
        return 2
    try:
        print(convert(*arguments), end="")
    except Refused as refused:
        print(f"error: {refused}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
