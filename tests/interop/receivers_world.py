"""Reads with pyubx2 and pymavlink what `gerono world` sends in place of a satellite receiver and of an autopilot.

    receivers_world.py GERONO SCENARIO
"""

import math
import socket
import subprocess
import sys
import tempfile
import time

from pymavlink.dialects.v20 import common as mavlink
from pyubx2 import UBXReader

SECONDS = 4.0
# The datum of the scenario and its azimuth, and its rates of fixes, inertial samples, fields and altitudes, Hz.
PLACE = (48.137154, 11.576124, 565.0)
AZIMUTH = 0.5
# A second antenna in the vehicle's frame, m: forward, right, down.
BASELINE = (0.8, -0.3, 0.1)
FIXES, INERTIAL, FIELDS, ALTITUDES = 10, 250, 50, 25


def free():
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    found.bind(("127.0.0.1", 0))
    found.settimeout(0.2)
    return found


def received(sockets, until):
    """Returns the packets that come to each socket until a time."""
    packets = [[] for _ in sockets]
    for one in sockets:
        one.setblocking(False)
    while time.monotonic() < until:
        for index, one in enumerate(sockets):
            try:
                while True:
                    packets[index].append(one.recv(2048))
            except BlockingIOError:
                pass
        time.sleep(0.005)
    return packets


def check(is_so, words):
    if not is_so:
        sys.exit(words)


def check_rate(name, count, rate):
    expected = rate * SECONDS
    check(0.7 * expected < count < 1.2 * expected, f"{count} {name}, expected about {expected:.0f}")


def check_increasing(name, times):
    check(all(one < other for one, other in zip(times, times[1:])), f"times of {name} do not increase")


def check_fixes(packets):
    fixes = [UBXReader.parse(packet) for packet in packets]
    check_rate("fixes", len(fixes), FIXES)
    check_increasing("fixes", [fix.iTOW for fix in fixes])
    for fix in fixes:
        check(fix.identity == "NAV-PVT", fix.identity)
        check((fix.fixType, fix.gnssFixOk, fix.diffSoln, fix.carrSoln) == (3, 1, 1, 2), f"kind of {fix}")
        north = (fix.lat - PLACE[0]) * 111_200
        east = (fix.lon - PLACE[1]) * 111_200 * math.cos(math.radians(PLACE[0]))
        up = fix.height / 1000 - PLACE[2]
        check(math.hypot(north, east) < 1.0 and abs(up) < 0.5, f"{north}, {east}, {up} m from the datum: {fix}")
        check(max(abs(fix.velN), abs(fix.velE), abs(fix.velD)) < 500, f"a vehicle at rest moves: {fix}")
        check(0 < fix.hAcc < 50 and 0 < fix.vAcc < 50 and 0 < fix.sAcc < 200, f"accuracies of {fix}")


def check_baselines(packets):
    """The vehicle stands level, with its x axis along that of the path's frame."""
    baselines = [UBXReader.parse(packet) for packet in packets]
    check_rate("baselines", len(baselines), FIXES)
    check_increasing("baselines", [baseline.iTOW for baseline in baselines])
    x, y, z = BASELINE
    expected = (
        x * math.cos(AZIMUTH) - y * math.sin(AZIMUTH),
        x * math.sin(AZIMUTH) + y * math.cos(AZIMUTH),
        z,
        math.hypot(x, y, z),
    )
    for baseline in baselines:
        check(baseline.version == 1, f"version of {baseline}")
        flags = (baseline.gnssFixOK, baseline.relPosValid, baseline.carrSoln, baseline.isMoving)
        check(flags == (1, 1, 2, 1) and baseline.relPosHeadingValid == 1, f"flags of {baseline}")
        # The library has added the high-precision parts to the centimetres.
        parts = (baseline.relPosN, baseline.relPosE, baseline.relPosD, baseline.relPosLength)
        found = [part / 100 for part in parts]
        check(all(abs(one - other) < 0.08 for one, other in zip(found, expected)), f"{found}, expected {expected}")
        check(abs(math.hypot(*found[:3]) - found[3]) < 3e-4, f"the length of {found}")
        heading = math.degrees(math.atan2(found[1], found[0])) % 360
        check(abs(baseline.relPosHeading - heading) < 0.02, f"a heading of {baseline.relPosHeading}, expected {heading}")
        check(abs(baseline.accN - 8) < 0.5 and abs(baseline.accD - 12) < 0.5, f"accuracies of {baseline}")
        check(0.3 < baseline.accHeading < 0.8, f"the accuracy of the heading of {baseline}")


def check_samples(packets):
    reader = mavlink.MAVLink(None)
    samples = [message for packet in packets for message in reader.parse_buffer(bytearray(packet)) or []]
    check(all(sample.get_type() == "HIGHRES_IMU" for sample in samples), "other messages")
    check_increasing("samples", [sample.time_usec for sample in samples])
    inertial = [sample for sample in samples if sample.fields_updated & 0x3F == 0x3F]
    fields = [sample for sample in samples if sample.fields_updated & 0x1C0 == 0x1C0]
    altitudes = [sample for sample in samples if sample.fields_updated & 0x800]
    check_rate("inertial samples", len(inertial), INERTIAL)
    check_rate("fields", len(fields), FIELDS)
    check_rate("altitudes", len(altitudes), ALTITUDES)
    down = sum(sample.zacc for sample in inertial) / len(inertial)
    check(abs(down + 9.81) < 0.5, f"{down} m/s² downwards of a vehicle at rest")
    check(all(abs(sample.zgyro) < 0.2 for sample in inertial), "a vehicle at rest turns")
    for field in fields:
        norm = math.hypot(field.xmag, field.ymag, field.zmag)
        check(0.35 < norm < 0.6, f"a field of {norm} G")
    for altitude in altitudes:
        check(abs(altitude.pressure_alt - PLACE[2]) < 3.0, f"an altitude of {altitude.pressure_alt} m")


def main():
    gerono, scenario = sys.argv[1:]
    fixes, motion, link = free(), free(), free()
    ports = [one.getsockname()[1] for one in (fixes, motion, link)]
    link.close()
    with tempfile.TemporaryDirectory() as folder:
        sources = f"receivers.sources=['udp:127.0.0.1:{ports[0]}','udp:127.0.0.1:{ports[1]}']"
        transmitter = f"rc_output.transmitter.udp='127.0.0.1:{ports[2]}'"
        place = list(BASELINE)
        antennas = [f"navigation.baseline={place}", f"sensors.gnss.baseline={place}"]
        antennas.append('schedule.period."gnss/baseline"=0.1')
        changes = [word for change in antennas for word in ("--set", change)]
        command = [gerono, "world", scenario, *changes, "--set", sources, "--set", transmitter, "--seconds", str(SECONDS)]
        world = subprocess.Popen([*command, "--quiet", "--out", f"{folder}/world"])
        try:
            packets = received([fixes, motion], time.monotonic() + SECONDS + 2)
        finally:
            code = world.wait(60)
    check(code == 0, f"the world ended with status {code}")
    fixes, baselines = ([packet for packet in packets[0] if packet[3] == id] for id in (0x07, 0x3C))
    check(len(fixes) + len(baselines) == len(packets[0]), "other packets")
    check_fixes(fixes)
    check_baselines(baselines)
    check_samples(packets[1])
    print(
        f"a simulated receiver and autopilot: {len(fixes)} fixes, {len(baselines)} baselines and {len(packets[1])} samples are read"
    )


if __name__ == "__main__":
    main()
