"""Waits until a simulated Betaflight would arm if a receiver asked for it: sitl_ready.py ADDRESS PORT.

It asks for MSP_STATUS_EX. Arming before its gyro is calibrated is refused until the switch is off again.
"""

import struct
import sys
import time

from sitl_msp import ask, connect

STATUS_EX = 150
# Of the flags of src/main/fc/runtime_config.h, those that do not wait for a receiver: no gyro, tilted, just started, too busy,
# calibrating, in the command line, without a protocol for its motors.
IN_THE_WAY = {"no gyro": 0, "tilted": 8, "just started": 9, "too busy": 11, "calibrating": 12, "command line": 13, "motors": 24}

address, port = sys.argv[1:]
patience = time.monotonic() + 60
line = connect(address, port)
while True:
    payload = ask(line, STATUS_EX)
    more_modes = payload[15] & 0x0F
    (flags,) = struct.unpack_from("<I", payload, 17 + more_modes)
    reasons = [reason for reason, bit in IN_THE_WAY.items() if flags >> bit & 1]
    if not reasons:
        break
    assert time.monotonic() < patience, f"will not arm: {reasons}"
    time.sleep(0.1)
