"""Sends packets with the Crazyflie's own library: radio_crazyflie.py READER COUNT, of the example `crazyflie_packets`.

Its driver finds the reader as it finds a simulator; what its users ask for must be what the reader understands, and packets
that ask for anything else than body rates, arming and the emergency stop must be refused. Of requests to the supervisor the
reader sends the very bytes, by the protocol of firmware before its release 2026.04 and since. Its users state roll right, pitch nose down and yaw
counter-clockwise as positive, in degrees per second."""

import math
import random
import socket
import subprocess
import sys
import warnings

from cflib.crazyflie.commander import Commander
from cflib.crazyflie.supervisor import Supervisor
from cflib.crtp.udpdriver import UdpDriver


class Vehicle:
    """As much of a vehicle as its commander and its supervisor use."""

    def __init__(self, driver, version=9):
        self.driver = driver
        self.platform = self
        self.get_protocol_version = lambda: version

    def add_port_callback(self, port, callback):
        pass

    def send_packet(self, packet):
        self.bytes = bytes([packet.get_header(), *packet.data])
        self.driver.send_packet(packet)


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
    warnings.simplefilter("ignore")
    # The versions of the releases 2025.09 and 2026.04.
    for version in (10, 12):
        vehicle = Vehicle(driver, version)
        supervisor = Supervisor(vehicle)
        for send, meant in [
            (lambda: supervisor.send_arming_request(True), "Arm(true)"),
            (lambda: supervisor.send_arming_request(False), "Arm(false)"),
            (supervisor.send_emergency_stop, "EmergencyStop"),
        ]:
            send()
            assert understood() == ["supervisor", meant, vehicle.bytes.hex()]
    others = [
        supervisor.send_emergency_stop_watchdog,
        supervisor.send_crash_recovery_request,
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
