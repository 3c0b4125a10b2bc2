"""Fails unless no motor of a simulated Betaflight turns: sitl_rest.py ADDRESS PORT. It asks for MSP_MOTOR."""

import struct
import sys

from sitl_msp import ask, connect

MOTOR = 104
# Pulse of a motor that rests, µs.
RESTS = 1000

address, port = sys.argv[1:]
motors = struct.unpack_from("<4H", ask(connect(address, port), MOTOR))
assert max(motors) <= RESTS, f"motors turn: {motors} µs"
