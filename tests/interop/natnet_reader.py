"""Reads what `gerono mocap send --as natnet` sends with PyPI's `natnet`, to the last byte.

    natnet_reader.py VERSION

It asks for the server, the descriptions and three hundred frames, each of which must hold the body `quad` at a new place.
"""

import socket
import struct
import sys

from natnet.data_descriptions import DataDescriptions
from natnet.data_frame import DataFrame
from natnet.packet_buffer import PacketBuffer
from natnet.server_info import ServerInfo
from natnet.version import Version

COMMANDS, FRAMES = ("127.0.0.1", 1510), ("127.0.0.1", 1511)
CONNECT, SERVERINFO, REQUEST_MODELDEF, MODELDEF, FRAME = 0, 1, 4, 5, 7
COUNT = 300


def payload(datagram, kind):
    """The bytes behind the head, which must state their length."""
    stated, length = struct.unpack_from("<HH", datagram)
    assert (stated, length) == (kind, len(datagram) - 4), (stated, length, len(datagram))
    return PacketBuffer(datagram[4:])


def ask(commands, question, answer):
    for _ in range(50):
        commands.sendto(struct.pack("<HH", question, 0), COMMANDS)
        try:
            return payload(commands.recv(65536), answer)
        except TimeoutError:
            continue
    raise SystemExit(f"no answer to {question}")


def left(buffer):
    return len(buffer.data) - buffer.pointer


def main():
    wanted = Version(*(int(part) for part in sys.argv[1].split(".")))
    commands = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    commands.settimeout(0.2)
    info = ServerInfo.read_from_buffer(ask(commands, CONNECT, SERVERINFO), wanted)
    assert info.nat_net_protocol_version.truncate(2) == wanted, info
    descriptions = ask(commands, REQUEST_MODELDEF, MODELDEF)
    bodies = DataDescriptions.read_from_buffer(descriptions, wanted).rigid_bodies
    assert left(descriptions) == 0, f"{left(descriptions)} bytes of the descriptions are left"
    (body,) = bodies
    assert body.name == "quad" and len(body.markers) == 3, body
    if wanted >= Version(4, 2):
        assert body.quat != (0.0, 0.0, 0.0, 1.0) and abs(sum(part * part for part in body.quat) - 1) < 1e-6, body
    frames = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    frames.settimeout(10)
    frames.bind(FRAMES)
    places = set()
    for _ in range(COUNT):
        buffer = payload(frames.recv(65536), FRAME)
        frame = DataFrame.read_from_buffer(buffer, wanted)
        # It does not read the mark of the end nor, from 4.1 on, the precision time before the flags.
        end = 12 if wanted >= Version(4, 1) else 4
        assert left(buffer) == end, f"{left(buffer)} bytes of a frame are left"
        (seen,) = frame.rigid_bodies
        assert seen.id_num == body.id_num and seen.tracking_valid, seen
        places.add(tuple(seen.pos))
    assert len(places) == COUNT, f"only {len(places)} places"
    print(f"{COUNT} frames and the descriptions of NatNet {sys.argv[1]} are read to the last byte")


main()
