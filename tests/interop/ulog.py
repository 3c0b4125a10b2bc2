"""Writes a flight of PX4's EKF2 tests as a ULog file, converts it, and compares what comes out with what went in.

    ulog.py SAMPLES.csv STATES.csv FOLDER

FOLDER gets flight.ulg, samples.csv and states.csv. The writer follows the specification of the format, and is not that of the
reader.
"""

import csv
import math
import struct
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

FORMATS = {
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;",
    "vehicle_magnetometer": "uint64_t timestamp;uint64_t timestamp_sample;float[3] magnetometer_ga;",
    "vehicle_air_data": "uint64_t timestamp;uint64_t timestamp_sample;float baro_alt_meter;",
    "vehicle_gps_position": "uint64_t timestamp;int32_t lat;int32_t lon;int32_t alt;float vel_n_m_s;float vel_e_m_s;"
    "float vel_d_m_s;float eph;float epv;float s_variance_m_s;uint8_t fix_type;",
    "vehicle_land_detected": "uint64_t timestamp;bool landed;",
    "vehicle_attitude": "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;",
    "vehicle_local_position": "uint64_t timestamp;uint64_t timestamp_sample;double ref_lat;double ref_lon;float ref_alt;float x;"
    "float y;float z;float vx;float vy;float vz;bool xy_global;bool z_global;bool v_xy_valid;bool v_z_valid;",
}

# Those of each fix: horizontal, vertical (m), and of the velocity (m/s).
ACCURACIES = [0.9, 1.8, 0.2]

# Relative error of a number that was rounded to single precision.
ROUNDED = 2.0**-24


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def ulog(samples: list, states: list, velocity_is_valid: bool | None = None) -> bytes:
    """The log of a version of PX4 that says of each fix whether its velocity is valid, or of one that does not."""
    formats = dict(FORMATS)
    if velocity_is_valid is not None:
        formats["vehicle_gps_position"] += "bool vel_ned_valid;"
    identifiers = {name: index for index, name in enumerate(FORMATS)}

    def data(name: str, layout: str, *values) -> bytes:
        return message("D", struct.pack("<H" + layout, identifiers[name], *values))

    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", int(samples[0][0])), message("B", bytes(40))]
    parts += [message("F", f"{name}:{fields}".encode()) for name, fields in formats.items()]
    key = b"float EKF2_GPS_DELAY"
    parts.append(message("P", bytes([len(key)]) + key + struct.pack("<f", 110.0)))
    parts += [message("A", struct.pack("<BH", 0, index) + name.encode()) for name, index in identifiers.items()]
    origin = None
    for time, kind, *numbers in samples:
        time = int(time)
        if kind not in ("imu", "mag", "baro", "gps", "landed"):
            continue
        numbers = [float(number) for number in numbers]
        if kind == "imu":
            parts.append(data("sensor_combined", "Q6f", time, *numbers[3:], *numbers[:3]))
        elif kind == "mag":
            parts.append(data("vehicle_magnetometer", "QQ3f", time + 700, time, *numbers))
        elif kind == "baro":
            parts.append(data("vehicle_air_data", "QQf", time + 900, time, *numbers))
        elif kind == "landed":
            parts.append(data("vehicle_land_detected", "Q?", time, bool(numbers[0])))
        else:
            height, longitude, latitude, *velocity = numbers
            origin = origin or (latitude * 1e-7, longitude * 1e-7, height * 1e-3)
            place = (round(latitude), round(longitude), round(height))
            flags = [3] if velocity_is_valid is None else [3, velocity_is_valid]
            parts.append(data("vehicle_gps_position", f"Q3i6f{len(flags)}B", time, *place, *velocity, *ACCURACIES, *flags))
    for time, *numbers in states:
        time, (w, x, y, z, vn, ve, vd, pn, pe, pd) = int(time), [float(number) for number in numbers[:10]]
        latitude, longitude, height = origin
        parts.append(data("vehicle_attitude", "QQ4f", time + 100, time, w, x, y, z))
        # PX4's origin is another place than the first fix: 10 m to the north, 20 m to the east, 1 m higher.
        latitude += math.degrees(10.0 / 6_371_000.0)
        longitude += math.degrees(20.0 / 6_371_000.0 / math.cos(math.radians(origin[0])))
        motion = (pn - 10.0, pe - 20.0, pd + 1.0, vn, ve, vd)
        parts.append(
            data("vehicle_local_position", "QQdd7f4?", time + 100, time, latitude, longitude, height + 1.0, *motion, 1, 1, 1, 1)
        )
    return b"".join(parts)


def rows(path: Path) -> list:
    with open(path, newline="") as file:
        return list(csv.reader(file))


def compare(first: list, second: list, relative: float, absolute: float = 0.0) -> None:
    """Fails unless the rows are the same up to these errors. The first number of each is a time, which is exact."""
    assert len(first) == len(second) > 0, (len(first), len(second))
    for one, other in zip(first, second):
        assert len(one) == len(other) and int(one[0]) == int(other[0]), (one, other)
        for a, b in zip(one[1:], other[1:]):
            assert math.isclose(float(a), float(b), rel_tol=relative, abs_tol=absolute), (one, other)


def fixes(table: Path) -> list:
    """The fixes of a table, each as its time and the numbers."""
    return [[time, *map(float, numbers)] for time, kind, *numbers in rows(table) if kind == "gps"]


def convert(log: Path, *tables: Path) -> subprocess.CompletedProcess:
    # Isolated: the module `math` of the package beside it is another one.
    program = ROOT / "python/gerono/ulog.py"
    return subprocess.run([sys.executable, "-I", program, log, *tables], capture_output=True, text=True)


def main() -> None:
    samples, states, folder = rows(Path(sys.argv[1])), rows(Path(sys.argv[2]))[1:], Path(sys.argv[3])
    log = folder / "flight.ulg"
    log.write_bytes(ulog(samples, states))
    tables = folder / "samples.csv", folder / "states.csv"
    done = convert(log, *tables)
    assert done.returncode == 0, done.stderr
    print(done.stdout, end="")
    assert "= 0.11\n" in done.stdout, done.stdout
    for kind in ["imu", "mag", "baro", "landed"]:
        went_in = [[time, *numbers] for time, name, *numbers in samples if name == kind]
        compare(went_in, [[time, *numbers] for time, name, *numbers in rows(tables[0]) if name == kind], ROUNDED)
    # Heights and angles are integers in this message: mm and 1e-7 degrees.
    sent = [[time, *map(float, numbers)] for time, kind, *numbers in samples if kind == "gps"]
    compare([[time, *map(round, numbers[:3])] for time, *numbers in sent], [row[:4] for row in fixes(tables[0])], 0.0, 1e-6)
    compare([[row[0], *row[4:]] for row in sent], [[row[0], *row[4:7]] for row in fixes(tables[0])], ROUNDED)
    compare([[row[0], 0.0, *ACCURACIES] for row in sent], [[row[0], *row[7:]] for row in fixes(tables[0])], ROUNDED)
    # The position is that of PX4, in single precision, from another origin.
    compare([row[:8] for row in states], [row[:8] for row in rows(tables[1])[1:]], ROUNDED)
    compare([[row[0], *row[8:11]] for row in states], [[row[0], *row[8:]] for row in rows(tables[1])[1:]], 0.0, 5e-5)

    # A velocity that is not valid is that of no motion; a log that says of all that they are valid is as one that says nothing.
    flagged, other = folder / "flagged.ulg", folder / "flagged.csv"
    for is_valid, velocity in [(True, None), (False, [0.0, 0.0, 0.0, 0.0, *ACCURACIES[:2], 100.0])]:
        flagged.write_bytes(ulog(samples, [], is_valid))
        done = convert(flagged, other)
        assert done.returncode == 0, done.stderr
        assert (f"left out: {len(sent)} velocities of fixes, which are not valid" in done.stdout) is not is_valid, done.stdout
        expected = [row if velocity is None else [*row[:4], *velocity] for row in fixes(tables[0])]
        compare(expected, fixes(other), ROUNDED)
    # A log that ends too soon is read up to there by PX4's reader; one that is damaged, or lacks a sensor, is refused.
    whole = log.read_bytes()
    (folder / "damaged.ulg").write_bytes(whole[:200_000] + bytes(400) + whole[200_400:])
    (folder / "other.ulg").write_bytes(b"no log" + whole)
    lacking = ulog([row for row in samples if row[1] != "baro"], states)
    (folder / "lacking.ulg").write_bytes(lacking)
    for name, words in [("damaged", "damaged"), ("other", "cannot be read"), ("lacking", "vehicle_air_data")]:
        done = convert(folder / f"{name}.ulg", *tables[:1])
        assert done.returncode == 1 and words in done.stderr, (name, done)
        print(f"{name}: {done.stderr}", end="")
    convert(log, *tables)


main()
