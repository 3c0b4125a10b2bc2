"""Feeds `gerono gnss probe` with packets of pyubx2 and pymavlink, on a pseudo-terminal and by UDP, and checks what it prints.

    receiver_lines.py GERONO
"""

import os
import pty
import socket
import subprocess
import sys
import threading
import time
import tty
from datetime import datetime, timezone

from pymavlink.dialects.v20 import common as mavlink
from pyubx2 import GET, UBXMessage

PERIOD = 0.1
AGE = 0.06
NMEA = b"$GNRMC,001031.00,A,4404.13993,N,12118.86023,W,0.146,,100117,,,A*7B\r\n"


def fix():
    """A fix of RTK that was valid a moment ago."""
    valid = time.time() - AGE
    utc = datetime.fromtimestamp(valid, timezone.utc)
    fields = {name: getattr(utc, name) for name in ("year", "month", "day", "hour", "second")}
    message = UBXMessage(
        "NAV",
        "NAV-PVT",
        GET,
        iTOW=int(valid * 1000) % 604_800_000,
        min=utc.minute,
        nano=utc.microsecond * 1000,
        validDate=1,
        validTime=1,
        fullyResolved=1,
        fixType=3,
        gnssFixOk=1,
        diffSoln=1,
        carrSoln=2,
        numSV=24,
        lat=47.4,
        lon=8.5,
        height=488_000,
        hAcc=14,
        vAcc=21,
        sAcc=50,
        **fields,
    )
    return message.serialize()


def measured(number, mav):
    """What an autopilot sends."""
    time_us = int(number * PERIOD * 1e6)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3)
    imu = mavlink.MAVLink_highres_imu_message(time_us, *[0.1] * 13, 8191)
    raw = mavlink.MAVLink_gps_raw_int_message(time_us, 3, 474_000_000, 85_000_000, 488_000, 100, 100, 0, 0, 14)
    return b"".join(message.pack(mav) for message in (heartbeat, imu, raw))


def probed(gerono, source, send):
    """Returns exit code and output of a probe while `send` is called each period."""
    is_over = threading.Event()

    def feed():
        number = 0
        while not is_over.wait(PERIOD):
            send(number)
            number += 1

    thread = threading.Thread(target=feed)
    thread.start()
    try:
        done = subprocess.run([gerono, "gnss", "probe", source, "--seconds", "4"], capture_output=True, text=True)
    finally:
        is_over.set()
        thread.join()
    return done.returncode, " ".join((done.stdout + done.stderr).replace("│", " ").split())


def check(name, got, code, words):
    missing = [word for word in words if word not in got[1]]
    if got[0] != code or missing:
        sys.exit(f"{name}: status {got[0]}, without {missing}: {got[1]}")
    print(f"{name}: as it should be")


def main():
    gerono = sys.argv[1]
    master, device = pty.openpty()
    tty.setraw(device)
    name = os.ttyname(device)

    def spoilt(number):
        packet = bytearray(fix())
        packet[40] ^= number % 10 == 5
        # In two pieces, with another message between packets.
        os.write(master, packet[:33])
        os.write(master, packet[33:] + UBXMessage("NAV", "NAV-STATUS", GET).serialize())

    words = ["RTK fixed 100.0 %", "24 satellites", "±0.014 m", "age on arrival", "other UBX messages", "wrong checksum"]
    check("a receiver on a serial line", probed(gerono, name, spoilt), 0, words)
    words = ["NMEA sentences", "NAV-PVT is not enabled"]
    check("a receiver that sends NMEA", probed(gerono, name, lambda _: os.write(master, NMEA)), 1, words)
    words = ["no UBX and no MAVLink", "Try --baud"]
    check("another speed", probed(gerono, name, lambda _: os.write(master, b"\x80\x78\x06" * 20)), 1, words)
    check("a silent line", probed(gerono, name, lambda _: None), 1, ["nothing was received", "power and wiring"])

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        address = free.getsockname()
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        got = probed(gerono, f"udp:{address[0]}:{address[1]}", lambda number: sender.sendto(measured(number, mav), address))
    words = ["HIGHRES_IMU", "single point 100.0 %", "14 satellites", "a flight needs 200 Hz", "no vertical velocity"]
    check("an autopilot by UDP", got, 0, words)


if __name__ == "__main__":
    main()
