"""Lets vehicles act on frames: radio_meaning.py FILE, of the example `vehicle_frames`. Decodes with programs that are not ours.

A line states a vehicle in pulses of its flight controller. What it does with a frame must be what was asked for."""

import json
import math
import struct
import sys

from radio import bits, crsf, crtp, messages


def betaflight_crsf(code):
    """crsfReadRawRC of Betaflight, rounded to what it is used as."""
    return 0.62477120195241 * code + 881


def betaflight_sbus(code):
    """sbusChannelsReadRawRC of Betaflight."""
    return 5 * code // 8 + 880


def module(code):
    """Percent of a MULTI module's documentation, 1024 the middle and 1843 all of it, as the pulse that they stand for."""
    return 1500 + 500 * (code - 1024) / 819.5


def pulses(link, frame):
    """The pulses of the channels, us; none of those that the frame leaves to a pilot."""
    if link == "crsf":
        return [betaflight_crsf(code) for code in crsf(frame)[0]]
    if link == "sbus":
        return [betaflight_sbus(bits(frame[1:23], 11 * i, 11)) for i in range(16)]
    if link == "multi":
        return [module(bits(frame[4:], 11 * i, 11)) for i in range(16)]
    assert link == "msp" and frame[:5] == b"$M<\x20\xc8"
    return [int.from_bytes(frame[5 + 2 * i:7 + 2 * i], "little") for i in range(16)]


def overridden(m):
    """RC_CHANNELS_OVERRIDE as common.xml defines it: UINT16_MAX, and of the channels from 9 on 0 as well, leave a channel alone."""
    fields = [getattr(m, f"chan{i}_raw") for i in range(1, 19)]
    assert 0 not in fields[:8] and 65534 not in fields[8:], "a channel is given back to the radio"
    return [None if field == 65535 or i >= 8 and field == 0 else field for i, field in enumerate(fields)]


def rates_of_a_crazyflie(frame):
    """manualDecoder and stopDecoder of the firmware: roll right, pitch nose up and yaw counter-clockwise are positive."""
    packet = crtp(frame)
    assert (packet.port, packet.channel) == (7, 0)
    if bytes(packet.data) == b"\0":
        return [0, 0, 0, 0]
    kind, roll, pitch, yaw, thrust, rate = struct.unpack("<BfffHB", packet.data)
    assert (kind, rate) == (11, 1)
    return [thrust / 65535] + [math.radians(number) for number in (roll, pitch, -yaw)]


def of_a_share(line, share, rates):
    idle = line["idle_share"]
    assert 0 <= share <= 1
    return [max(0, (share - idle) / (1 - idle)) * line["largest"], *rates]


def understood(line, frame):
    link = line["link"]
    if link == "crazyflie":
        share, *rates = rates_of_a_crazyflie(frame)
        return of_a_share(line, share, rates)
    if link == "mavlink":
        m = messages(frame)[-1]
        if m.get_type() == "SET_ATTITUDE_TARGET":
            assert m.type_mask == 128
            return of_a_share(line, m.thrust, [m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate])
        received = overridden(m)
        assert [i for i, pulse in enumerate(received) if pulse is not None] == sorted(line["channels"])
    else:
        received = pulses(link, frame)
    thrust, *rates = (received[channel] for channel in line["channels"])
    none, full = line["thrust"]
    share = min(1, max(0, (thrust - none) / (full - none)))
    turns = [rate * (pulse - middle) / (most - middle)
             for pulse, rate, (middle, most) in zip(rates, line["rate"], line["rates"])]
    return [share * line["largest"], *turns]


count = {}
for text in open(sys.argv[1]):
    line = json.loads(text)
    found = understood(line, bytes.fromhex(line["frame"]))
    asked, (thrust, rate) = line["asked"], line["tolerance"]
    if asked is None:
        assert found[0] <= line["stopped"], f"the motors turn with {found[0]} N: {text}"
        asked = [0] * 4
    for one, other, most in zip(found, asked, [thrust, rate, rate, rate]):
        assert abs(one - other) <= most, f"{one} for {other}, {text}"
    count[line["link"]] = count.get(line["link"], 0) + 1
assert len(count) == 6
print(", ".join(f"{link}: {frames}" for link, frames in count.items()), "frames understood as they were meant")
