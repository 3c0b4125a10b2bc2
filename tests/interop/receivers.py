"""Writes packets of a satellite receiver and of an autopilot, and what they mean.

    receivers.py COUNT SEED

COUNT random packets of each kind, by pyubx2 and pymavlink. A line is a packet: the name of its message, its bytes, and the
numbers that the library reads from them, in the units of services/navigation_receivers; `nan` stands for a number that is not
known.
"""

import calendar
import math
import random
import sys

from pymavlink.dialects.v10 import common as mavlink_1
from pymavlink.dialects.v20 import common as mavlink
from pyubx2 import GET, UBXMessage, UBXReader

NAN = math.nan


def print_packet(name, packet, numbers):
    words = [f"{key}={value!r}" for key, value in numbers.items()]
    print(name, packet.hex(), *words)


def nav_pvt(chosen):
    whole = chosen.randrange
    has_time = chosen.random() < 0.8
    message = UBXMessage(
        "NAV",
        "NAV-PVT",
        GET,
        iTOW=whole(604_800_000),
        year=whole(2000, 2100),
        month=whole(1, 13),
        day=whole(1, 29),
        hour=whole(24),
        min=whole(60),
        second=whole(60),
        validDate=has_time,
        validTime=has_time or chosen.random() < 0.5,
        fullyResolved=has_time,
        tAcc=whole(2**32),
        nano=whole(-(10**9), 10**9),
        fixType=whole(6),
        gnssFixOk=whole(2),
        diffSoln=whole(2),
        headVehValid=whole(2),
        carrSoln=whole(3),
        numSV=whole(64),
        lon=chosen.uniform(-180, 180),
        lat=chosen.uniform(-90, 90),
        height=whole(-(10**6), 10**7),
        hMSL=whole(-(10**6), 10**7),
        hAcc=whole(2**32),
        vAcc=whole(10**5),
        velN=whole(-(10**5), 10**5),
        velE=whole(-(10**5), 10**5),
        velD=whole(-(10**5), 10**5),
        gSpeed=whole(10**5),
        headMot=chosen.uniform(0, 360),
        sAcc=whole(10**5),
        headAcc=chosen.uniform(0, 180),
        pDOP=chosen.uniform(0, 99),
        invalidLlh=chosen.random() < 0.1,
        headVeh=chosen.uniform(0, 360),
    )
    packet = message.serialize()
    read = UBXReader.parse(packet)
    utc = calendar.timegm((read.year, read.month, read.day, read.hour, read.min, read.second))
    utc_ns = utc * 10**9 + read.nano
    has_utc = read.validDate and read.validTime and read.fullyResolved
    has_position = read.fixType in (1, 2, 3, 4)
    is_valid = read.gnssFixOk and not (has_position and read.invalidLlh)
    # The library gives the time of the week as one of a day.
    itow = int.from_bytes(packet[6:10], "little")
    numbers = {
        "time_of_week_ms": itow,
        "utc_us": utc_ns // 1000 if has_utc else NAN,
        "utc_rest_ns": utc_ns % 1000 if has_utc else NAN,
        "time_accuracy": read.tAcc * 1e-9,
        "solution": read.fixType,
        "is_valid": int(is_valid),
        "has_corrections": read.diffSoln,
        "carrier": read.carrSoln,
        "kind": read.carrSoln if is_valid and read.fixType in (3, 4) else NAN,
        "satellites": read.numSV,
        "latitude": read.lat,
        "longitude": read.lon,
        "height": read.height / 1000,
        "height_above_sea": read.hMSL / 1000,
        "north": read.velN / 1000,
        "east": read.velE / 1000,
        "down": read.velD / 1000,
        "horizontal_accuracy": read.hAcc / 1000,
        "vertical_accuracy": read.vAcc / 1000,
        "speed_accuracy": read.sAcc / 1000,
        "position_dilution": read.pDOP,
        "heading": math.radians(read.headVeh) if read.headVehValid else NAN,
        "heading_deviation": math.radians(read.headAcc) if read.headVehValid else NAN,
    }
    print_packet("NAV-PVT", packet, numbers)


def nav_relposned(chosen):
    whole = chosen.randrange
    fine = {f"_HPrelPos{axis}": whole(-99, 100) / 100 for axis in ("N", "E", "D", "Length")}
    time_of_week = whole(604_800_000)
    message = UBXMessage(
        "NAV",
        "NAV-RELPOSNED",
        GET,
        version=1,
        iTOW=time_of_week,
        # Without a draw: packets after it are as before.
        isMoving=time_of_week % 2,
        relPosN=whole(-(10**6), 10**6),
        relPosE=whole(-(10**6), 10**6),
        relPosD=whole(-(10**6), 10**6),
        relPosLength=whole(10**6),
        relPosHeading=chosen.uniform(0, 360),
        accN=chosen.uniform(0, 1000),
        accE=chosen.uniform(0, 1000),
        accD=chosen.uniform(0, 1000),
        accHeading=chosen.uniform(0, 180),
        gnssFixOK=whole(2),
        relPosValid=whole(2),
        carrSoln=whole(3),
        relPosHeadingValid=whole(2),
        **fine,
    )
    packet = message.serialize()
    read = UBXReader.parse(packet)
    # Centimetres, with the part below one added.
    length = {axis: getattr(read, f"relPos{axis}") / 100 for axis in ("N", "E", "D", "Length")}
    numbers = {
        "time_of_week_ms": int.from_bytes(packet[10:14], "little"),
        "north": length["N"],
        "east": length["E"],
        "down": length["D"],
        "length": length["Length"],
        "north_accuracy": read.accN / 1000,
        "east_accuracy": read.accE / 1000,
        "down_accuracy": read.accD / 1000,
        "carrier": read.carrSoln,
        "is_valid": int(read.gnssFixOK and read.relPosValid),
        "is_moving": read.isMoving,
        "heading": math.radians(read.relPosHeading) if read.relPosHeadingValid else NAN,
        "heading_deviation": math.radians(read.accHeading) if read.relPosHeadingValid else NAN,
    }
    print_packet("NAV-RELPOSNED", packet, numbers)


class Autopilot:
    """Sender of MAVLink 1, of MAVLink 1 with extensions, as pymavlink sends it, and of MAVLink 2 with and without a signature."""

    def __init__(self, chosen):
        self.chosen = chosen
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.mav.signing.secret_key = bytes(32)
        self.mav.signing.timestamp = 1
        self.mav_1 = mavlink_1.MAVLink(None, srcSystem=1, srcComponent=1)

    def send(self, message, numbers, can_be_1=True):
        form = self.chosen.choice(["1", "1 extended", "2", "signed"] if can_be_1 else ["2", "signed"])
        self.mav.signing.sign_outgoing = form == "signed"
        self.mav.seq = self.mav_1.seq = self.chosen.randrange(256)
        if form == "1":
            kind = getattr(mavlink_1, type(message).__name__)
            message = kind(*[getattr(message, name) for name in kind.fieldnames])
            packet = message.pack(self.mav_1)
            read = mavlink_1.MAVLink(None).parse_buffer(packet)[0]
        else:
            packet = message.pack(self.mav, force_mavlink1=form == "1 extended")
            read = mavlink.MAVLink(None).parse_buffer(packet)[0]
        print_packet(message.get_type(), packet, numbers(read, form != "1"))

    def heartbeat(self):
        whole = self.chosen.randrange
        message = mavlink.MAVLink_heartbeat_message(whole(40), whole(20), whole(256), whole(2**32), 4, 3)
        self.send(
            message,
            lambda read, _: {
                "autopilot": read.autopilot,
                "kind": read.type,
                "is_armed": read.base_mode >> 7,
            },
        )

    def gps_raw_int(self):
        chosen, whole = self.chosen, self.chosen.randrange
        states = chosen.random() < 0.7
        extensions = {}
        if states:
            extensions = {
                "alt_ellipsoid": whole(-(10**5), 10**7),
                "h_acc": whole(1, 10**5),
                "v_acc": whole(10**5),
                "vel_acc": whole(10**5),
                "hdg_acc": whole(1, 10**6),
                "yaw": chosen.choice([0, 65535, 36000, whole(1, 36000)]),
            }
        message = mavlink.MAVLink_gps_raw_int_message(
            whole(2**63),
            whole(9),
            whole(-900_000_000, 900_000_000),
            whole(-1_800_000_000, 1_800_000_000),
            whole(-(10**5), 10**7),
            whole(2**16),
            whole(2**16),
            chosen.choice([65535, whole(10_000)]),
            chosen.choice([65535, whole(36_000)]),
            chosen.choice([255, whole(60)]),
            **extensions,
        )

        def numbers(read, is_extended):
            has_more = is_extended and states
            has_yaw = is_extended and 1 <= read.yaw <= 36000
            kinds = {3: 0, 4: 0, 8: 0, 5: 1, 6: 2}
            return {
                "time_us": read.time_usec,
                "fix_type": read.fix_type,
                "kind": kinds.get(read.fix_type, NAN),
                "latitude": read.lat / 1e7,
                "longitude": read.lon / 1e7,
                "height_above_sea": read.alt / 1000,
                "ground_speed": NAN if read.vel == 65535 else read.vel / 100,
                "course": NAN if read.cog == 65535 else math.radians(read.cog / 100),
                "satellites": NAN if read.satellites_visible == 255 else read.satellites_visible,
                "height": read.alt_ellipsoid / 1000 if has_more and (read.alt_ellipsoid or not read.alt) else NAN,
                "horizontal_accuracy": read.h_acc / 1000 if has_more else NAN,
                "vertical_accuracy": read.v_acc / 1000 if has_more else NAN,
                "speed_accuracy": read.vel_acc / 1000 if has_more else NAN,
                "heading": math.radians(read.yaw / 100) if has_yaw else NAN,
                "heading_deviation": math.radians(read.hdg_acc / 1e5) if has_yaw else NAN,
            }

        self.send(message, numbers)

    def highres_imu(self):
        chosen, whole = self.chosen, self.chosen.randrange
        groups = [0b111, 0b111 << 3, 0b111 << 6, 1 << 9, 1 << 10, 1 << 11, 1 << 12]
        updated = sum(mask for mask in groups if chosen.random() < 0.7)
        values = [chosen.uniform(-20, 20) for _ in range(13)]
        message = mavlink.MAVLink_highres_imu_message(whole(2**63), *values, updated, id=whole(4))

        def numbers(read, is_extended):
            names = [
                ("force", ["xacc", "yacc", "zacc"], 0b111, 1),
                ("rate", ["xgyro", "ygyro", "zgyro"], 0b111 << 3, 1),
                ("field", ["xmag", "ymag", "zmag"], 0b111 << 6, 1),
                ("pressure", ["abs_pressure"], 1 << 9, 100),
                ("pressure_altitude", ["pressure_alt"], 1 << 11, 1),
                ("temperature", ["temperature"], 1 << 12, 1),
            ]
            said = {"time_us": read.time_usec, "sensor": read.id if is_extended else 0}
            for name, fields, mask, factor in names:
                for index, field in enumerate(fields):
                    is_there = read.fields_updated & mask == mask
                    said[f"{name}{index}"] = factor * getattr(read, field) if is_there else NAN
            return said

        self.send(message, numbers)

    def odometry(self):
        chosen, whole = self.chosen, self.chosen.randrange
        quaternion = [chosen.gauss(0, 1) for _ in range(4)]
        norm = math.sqrt(sum(component**2 for component in quaternion))
        velocity = [chosen.uniform(-20, 20) for _ in range(3)] if chosen.random() < 0.8 else [NAN] * 3
        rates = [chosen.uniform(-9, 9) for _ in range(3)] if chosen.random() < 0.8 else [NAN] * 3
        matrices = [
            [chosen.uniform(0, 2) for _ in range(21)] if chosen.random() < 0.8 else [NAN] * 21 for _ in range(2)
        ]
        message = mavlink.MAVLink_odometry_message(
            whole(2**63),
            1,
            12,
            *[chosen.uniform(-1000, 1000) for _ in range(3)],
            [component / norm for component in quaternion],
            *velocity,
            *rates,
            *matrices,
            reset_counter=whole(256),
            estimator_type=3,
            quality=whole(100),
        )

        def numbers(read, _):
            said = {"time_us": read.time_usec, "resets": read.reset_counter}
            said |= {"frame": read.frame_id, "child_frame": read.child_frame_id}
            groups = {
                "position": [read.x, read.y, read.z],
                "quaternion": read.q,
                "velocity": [read.vx, read.vy, read.vz],
                "rate": [read.rollspeed, read.pitchspeed, read.yawspeed],
                "position_variance": [read.pose_covariance[at] for at in (0, 6, 11)],
                "velocity_variance": [read.velocity_covariance[at] for at in (0, 6, 11)],
            }
            for name, values in groups.items():
                said |= {f"{name}{index}": value for index, value in enumerate(values)}
            return said

        # Its ID does not fit into MAVLink 1.
        self.send(message, numbers, can_be_1=False)


def main():
    count, seed = int(sys.argv[1]), int(sys.argv[2])
    chosen = random.Random(seed)
    autopilot = Autopilot(chosen)
    for _ in range(count):
        nav_pvt(chosen)
        nav_relposned(chosen)
        autopilot.heartbeat()
        autopilot.gps_raw_int()
        autopilot.highres_imu()
        autopilot.odometry()


if __name__ == "__main__":
    main()
