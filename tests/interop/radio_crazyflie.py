"""Sends packets with the Crazyflie's own library: radio_crazyflie.py READER COUNT, of the example `crazyflie_packets`.

Its driver finds the reader as it finds a simulator; what its users ask for must be what the reader understands, and packets
that ask for anything else than body rates must be refused. Its users state roll right, pitch nose down and yaw
counter-clockwise as positive, in degrees per second."""

import math
import random
import socket
import subprocess
import sys

from cflib.crazyflie.commander import Commander
from cflib.crtp.udpdriver import UdpDriver


class Vehicle:
    """As much of a vehicle as its commander uses."""

    class Platform:
        def get_protocol_version(self):
            return 9

    platform = Platform()

    def __init__(self, driver):
        self.send_packet = driver.send_packet


def main(path, count):
    reader = subprocess.Popen([path], stdout=subprocess.PIPE, text=True)
    port = int(reader.stdout.readline())
    uri = f"udp://127.0.0.1:{port}"
    found = [uri for uri, _ in UdpDriver().scan_interface()]
    assert uri in found, f"{uri} is not among {found}"
    driver = UdpDriver()
    driver.connect(uri, None, lambda reason: sys.exit(reason))
    commander = Commander(Vehicle(driver))

    def understood():
        return reader.stdout.readline().split()

    source = random.Random(7)
    for number in range(count):
        roll, pitch, yaw = (source.uniform(-2000, 2000) for _ in range(3))
        percent = source.uniform(0, 100)
        commander.send_setpoint_manual(roll, pitch, yaw, percent, True)
        kind, x, y, z, thrust = understood()
        # About forward, right, down: nose up and clockwise are positive.
        meant = [math.radians(rate) for rate in (roll, -pitch, -yaw)]
        for one, other in zip((x, y, z), meant):
            assert abs(float(one) - other) < 1e-5, f"packet {number}: {one} for {other}"
        assert kind == "rates" and int(thrust) == int(10001 + 0.01 * percent * 49999), f"packet {number}: {thrust}"
    commander.send_stop_setpoint()
    assert understood() == ["stop"]
    commander.send_notify_setpoint_stop(250)
    assert understood() == ["end", "250"]
    others = [
        lambda: commander.send_setpoint_manual(1, 2, 3, 50, False),
        lambda: commander.send_setpoint(1, 2, 3, 40000),
        lambda: commander.send_hover_setpoint(0, 0, 0, 1),
        lambda: commander.send_zdistance_setpoint(0, 0, 0, 1),
        lambda: commander.send_velocity_world_setpoint(0, 0, 0, 0),
        lambda: commander.send_position_setpoint(0, 0, 1, 0),
        lambda: commander.send_full_state_setpoint([0] * 3, [0] * 3, [0] * 3, [0, 0, 0, 1], 0, 0, 0),
    ]
    for send in others:
        send()
        assert understood() == ["refused"]
    driver.close()
    socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"", ("127.0.0.1", port))
    assert reader.wait(10) == 0
    print(f"crazyflie: {count} packets of its own library understood, {len(others)} of other kinds refused")


main(sys.argv[1], int(sys.argv[2]))
