"""Compares what an independent client sees of `gerono mocap send` with the eight that it sends.

    motion_capture.py SYSTEM [KEY=VALUE…]
"""

import math
import sys
import time

import motioncapture

SIZE, HEIGHT, TILT = 1.2, 1.2, math.pi / 20
FRAMES = 300


def in_the_papers_frame(system, position):
    """z down, from the axes of the system."""
    x, y, z = (float(coordinate) for coordinate in position)
    return (x, z, -y) if system == "optitrack" else (x, -y, -z)


def check(system, body):
    x, y, z = in_the_papers_frame(system, body.position)
    # Back from the tilt, to l sin cos, l sin, −height.
    y, z = math.cos(TILT) * y - math.sin(TILT) * z, math.sin(TILT) * y + math.cos(TILT) * z
    sine = y / SIZE
    off = abs(z + HEIGHT) + abs(x * x - (SIZE * sine) ** 2 * (1 - sine * sine))
    assert off < 1e-5, f"{off} off the eight at {x, y, z}"
    q = body.rotation
    # Level, nose along the way: a turn about the vertical only, left being positive in z-up and y-up alike.
    about, others = (q.y, (q.x, q.z)) if system == "optitrack" else (q.z, (q.x, q.y))
    assert max(map(abs, others)) < 1e-5, f"not level: {q}"
    yaw = -2 * math.atan2(about, q.w)
    # The way is (cos 2wγ, cos wγ).
    cosine = math.copysign(math.sqrt(max(0.0, 1 - sine * sine)), math.sin(yaw))
    wanted = math.atan2(cosine, 1 - 2 * sine * sine)
    turned = abs(math.remainder(yaw - wanted, 2 * math.pi))
    assert turned < 5e-3 or abs(cosine) < 0.02, f"yaw is {yaw}, not {wanted}"


def main():
    system = sys.argv[1]
    settings = dict(argument.split("=", 1) for argument in sys.argv[2:])
    if system == "vrpn":
        settings["updateFrequency"] = "200"
    time.sleep(1)
    capture = motioncapture.connect(system, settings)
    seen, places = 0, set()
    while seen < FRAMES:
        capture.waitForNextFrame()
        for name, body in capture.rigidBodies.items():
            assert name == "quad", name
            check(system, body)
            places.add(tuple(body.position))
            seen += 1
    assert len(places) > FRAMES / 2, f"only {len(places)} places"
    print(f"{seen} frames of {system} are on the eight, at {len(places)} places")


main()
