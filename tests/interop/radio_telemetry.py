"""Battery voltages made by published libraries, read here: radio_telemetry.py FOLDER COUNT, with the folder of the examples
`telemetry` and `crazyflie_battery`.

CRSF by crsf-parser, MAVLink by pymavlink. A Crazyflie's own library sets its log up at our simulated vehicle, and reads the
voltage that our client would read; our client's requests are the library's, byte by byte (`cargo test -p radio_link`)."""

import random
import socket
import struct
import subprocess
import sys
import tempfile
import time


def read(folder, link, data):
    with tempfile.NamedTemporaryFile() as file:
        file.write(data)
        file.flush()
        lines = subprocess.run([f"{folder}/telemetry", link, file.name], check=True, capture_output=True, text=True).stdout
    return [line.split()[1] for line in lines.splitlines()]


def crsf(source, count):
    from crsf_parser.handling import crsf_build_frame
    from crsf_parser.payloads import PacketsTypes
    data, wanted = b"", []
    for _ in range(count):
        tenths = source.randrange(10, 1000)
        payload = {"voltage": tenths, "current": source.randrange(1000), "capacity": source.randrange(1 << 16),
                   "remaining": source.randrange(101)}
        data += bytes(crsf_build_frame(PacketsTypes.BATTERY_SENSOR, payload, 0xEA))
        wanted.append(str(100 * tenths))
    return data, wanted


class Sink:
    def __init__(self):
        self.data = b""

    def write(self, data):
        self.data += bytes(data)


def mavlink(source, count):
    from pymavlink.dialects.v20 import common
    sink, wanted = Sink(), []
    link = common.MAVLink(sink, srcSystem=1, srcComponent=1)
    for number in range(count):
        millivolts = source.randrange(1000, 60000)
        if number % 2:
            link.sys_status_send(1, 2, 3, 500, millivolts, -1, 60, 0, 0, 0, 0, 0, 0)
        else:
            cells = source.randrange(1, 10)
            parts = [millivolts // cells] * (cells - 1)
            parts.append(millivolts - sum(parts))
            link.battery_status_send(0, 1, 1, 2500, parts + [65535] * (10 - cells), 1200, 800, -1, 55)
        wanted.append(str(millivolts))
    return sink.data, wanted


def crazyflie(folder):
    """The library's own order: reset, table of contents, block, data."""
    from cflib.crazyflie.log import Log, LogConfig
    from cflib.crtp.crtpstack import CRTPPacket
    from cflib.crazyflie.toccache import TocCache
    vehicle = subprocess.Popen([f"{folder}/crazyflie_battery"], stdout=subprocess.PIPE, text=True)
    port = int(vehicle.stdout.readline())
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    line.connect(("127.0.0.1", port))
    line.settimeout(1)

    class Crazyflie:
        link = True

        class platform:
            @staticmethod
            def get_protocol_version():
                return 10

        def __init__(self):
            self.callbacks = []

        def add_port_callback(self, number, callback):
            self.callbacks.append((number, callback))

        def remove_port_callback(self, number, callback):
            self.callbacks.remove((number, callback))

        def send_packet(self, packet, expected_reply=None):
            line.send(bytes([packet.get_header()]) + bytes(packet.data))

        def step(self):
            data = line.recv(1024)
            packet = CRTPPacket(header=data[0], data=data[1:])
            for number, callback in list(self.callbacks):
                if packet.port == number:
                    callback(packet)

    vehicle_at = Crazyflie()
    log = Log(vehicle_at)
    vehicle_at.log = log
    done = []
    log.refresh_toc(lambda: done.append(True), TocCache())
    while not done:
        vehicle_at.step()
    block = LogConfig("battery", 200)
    block.add_variable("pm.vbat", "float")
    found = []
    block.data_received_cb.add_callback(lambda _, data, __: found.append(data["pm.vbat"]))
    log.add_config(block)
    block.create()
    began = time.monotonic()
    while len(found) < 3 and time.monotonic() < began + 10:
        vehicle_at.step()
    assert found == [3.75] * 3, found
    line.send(b"")
    assert vehicle.wait(10) == 0


def main(folder, count):
    source = random.Random(7)
    for make in (crsf, mavlink):
        data, wanted = make(source, count)
        found = read(folder, make.__name__, data)
        assert found == wanted, next(pair for pair in zip(found, wanted) if pair[0] != pair[1])
        print(f"{make.__name__}: {count} battery voltages of another library read exactly")
    crazyflie(folder)
    print("crazyflie: its own library reads the simulated vehicle's battery")


main(sys.argv[1], int(sys.argv[2]))
