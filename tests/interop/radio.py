"""Compares frames with what they were made of: radio.py LINK FRAMES VALUES. Decodes with programs that are not ours."""

import math
import struct
import sys


def crsf(data):
    from crsf_parser import CRSFParser, PacketValidationStatus
    found = []

    def take(frame, status):
        assert status == PacketValidationStatus.VALID, status
        # It swaps the bytes of the packed channels, and so has the last channel first.
        found.append(list(frame.payload.channels)[::-1])

    parser = CRSFParser(take)
    for at in range(0, len(data), 26):
        parser.parse_stream(bytearray(data[at:at + 26]))
    stats = parser.get_stats()
    assert (stats.invalid_frames, stats.crc_errors, stats.framing_errors) == (0, 0, 0), stats
    return found


def bits(data, at, count):
    """A field of a number whose first byte is the lowest: another way to read packed channels than the encoder's."""
    return int.from_bytes(data, "little") >> at & (1 << count) - 1


def sbus(data):
    found = []
    for frame in (data[at:at + 25] for at in range(0, len(data), 25)):
        assert frame[0] == 0x0F and frame[24] == 0
        found.append([bits(frame[1:23], 11 * i, 11) for i in range(16)] + [frame[23]])
    return found


def multi(data):
    """After the comment "MULTI protocol serial definition" in Multiprotocol.h of the module's firmware."""
    found = []
    for frame in (data[at:at + 26] for at in range(0, len(data), 26)):
        assert frame[0] == 0x55 and frame[1] & 0x1F == 6 and not frame[1] & 0x60
        channels = [bits(frame[4:], 11 * i, 11) for i in range(16)]
        found.append(channels + [frame[2] & 15, frame[2] >> 4 & 7, frame[3], frame[2] >> 7, frame[1] >> 7])
    return found


def messages(data):
    from pymavlink.dialects.v20 import common
    link = common.MAVLink(None)
    found = link.parse_buffer(data)
    assert found is not None and link.total_receive_errors == 0
    return found


def word(number):
    return struct.unpack("<I", struct.pack("<f", number))[0]


def mavlink(data):
    found = []
    for m in messages(data):
        assert m.get_type() == "SET_ATTITUDE_TARGET" and m.type_mask == 128 and (m.target_system, m.target_component) == (1, 1)
        rates = [m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate]
        found.append([m.time_boot_ms] + [word(number) for number in rates + [m.thrust]])
    return found


def override(data):
    return [[getattr(m, f"chan{i}_raw") for i in range(1, 17)] for m in messages(data)]


def crtp(data):
    """The packet of a datagram, as the driver of the Crazyflie's own library makes it."""
    from cflib.crtp.crtpstack import CRTPPacket
    return CRTPPacket(header=data[0], data=data[1:])


class Recorder:
    """A vehicle that keeps what its commander sends."""

    def send_packet(self, pk):
        self.packet = pk


def crazyflie(data):
    """Read as the library packs it, and compared with the packet that the library makes of the same command: its users
    state roll right, pitch nose down and yaw counter-clockwise as positive. About forward, right, down pitch and yaw have
    the opposite signs."""
    from cflib.crazyflie import commander as library
    from cflib.crtp.crtpstack import CRTPPort
    vehicle, found = Recorder(), []
    commander = library.Commander(vehicle)
    for datagram in (data[at:at + 17] for at in range(0, len(data), 17)):
        packet = crtp(datagram)
        assert (packet.port, packet.channel) == (CRTPPort.COMMANDER_GENERIC, library.SET_SETPOINT_CHANNEL)
        kind, roll, minus_pitch, yaw, thrust, rate = struct.unpack("<BfffHB", packet.data)
        assert (kind, rate) == (library.TYPE_MANUAL, True)
        if 10001 <= thrust <= 60000:
            percent = min(100, (thrust - 10001 + 0.5) / 499.99)
            commander.send_setpoint_manual(roll, -minus_pitch, yaw, percent, True)
            sent = bytes([vehicle.packet.get_header()]) + bytes(vehicle.packet.data)
            assert sent == datagram, f"{sent.hex()} for {datagram.hex()}"
        pitch = -minus_pitch
        found.append([round(1e6 * math.radians(number)) for number in (roll, -pitch, -yaw)] + [thrust])
    return found


def is_same(one, other, tolerance):
    return len(one) == len(other) and all(abs(a - b) <= tolerance for a, b in zip(one, other))


if __name__ == "__main__":
    link, frames, values = sys.argv[1:]
    wanted = [[int(number) for number in line.split()] for line in open(values)]
    found = {f.__name__: f for f in (crsf, sbus, multi, mavlink, override, crazyflie)}[link](open(frames, "rb").read())
    assert len(found) == len(wanted), f"{link}: {len(found)} frames of {len(wanted)}"
    for number, (one, other) in enumerate(zip(found, wanted)):
        # Numbers of 32 bits in degrees per second.
        tolerance = 4 if link == "crazyflie" else 0
        assert is_same(list(one), other, tolerance), f"{link}: frame {number} carries {other}, read as {list(one)}"
    print(f"{link}: {len(found)} frames read exactly")
