"""Fails unless no motor of a simulated Betaflight turns: sitl_rest.py ADDRESS PORT. It asks for MSP_MOTOR."""

import socket
import struct
import sys

MOTOR = 104
# Pulse of a motor that rests, µs.
RESTS = 1000

address, port = sys.argv[1:]
line = socket.create_connection((address, int(port)), timeout=10)
line.sendall(b"$M<" + bytes([0, MOTOR, MOTOR]))
answer = b""
while len(answer) < 6 or len(answer) < 6 + answer[3]:
    piece = line.recv(4096)
    assert piece, f"ended after {answer!r}"
    answer += piece
assert answer[:3] == b"$M>" and answer[4] == MOTOR, answer
motors = struct.unpack_from("<4H", answer, 5)
assert max(motors) <= RESTS, f"motors turn: {motors} µs"
