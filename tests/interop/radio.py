"""Compares frames with what they were made of: radio.py LINK FRAMES VALUES. Decodes with programs that are not ours."""

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


if __name__ == "__main__":
    link, frames, values = sys.argv[1:]
    wanted = [[int(number) for number in line.split()] for line in open(values)]
    found = {f.__name__: f for f in (crsf, sbus, multi, mavlink, override)}[link](open(frames, "rb").read())
    assert len(found) == len(wanted), f"{link}: {len(found)} frames of {len(wanted)}"
    for number, (one, other) in enumerate(zip(found, wanted)):
        assert list(one) == other, f"{link}: frame {number} carries {other}, read as {list(one)}"
    print(f"{link}: {len(found)} frames read exactly")
