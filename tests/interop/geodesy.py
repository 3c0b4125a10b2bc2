"""Compares positions in the frame of a flight with PROJ (pyproj) and pymap3d.

    geodesy.py PLACES

PLACES is the example of `shared_types`. The axes of {I} are to the north, to the east and downwards at the datum, turned about the
vertical by the azimuth of x.
"""

import math
import random
import subprocess
import sys

import pymap3d
import pyproj

FLIGHTS = 2000
# Largest distance from the libraries, m: a step of double precision at the earth's radius is 1e-9.
LIMIT = 2e-8
# Length of a degree of latitude, m.
DEGREE = 111_320.0

# Where formulas fail first: the poles, the antimeridian, the equator, the highest mountain, the Dead Sea.
EDGES = [(89.99, 10.0, 0.0), (-89.99, -170.0, 2800.0), (0.0, 179.999, 0.0), (0.0, -179.999, 5.0), (0.0, 0.0, 0.0)]
EDGES += [(27.988, 86.925, 8848.0), (31.5, 35.5, -430.0), (48.137154, 11.576124, 565.0)]


def flights(count: int) -> list[list[float]]:
    """Datum, azimuth and position of each flight."""
    numbers = random.Random(1)
    found = []
    for index in range(count):
        if index < 10 * len(EDGES):
            datum = EDGES[index % len(EDGES)]
        else:
            datum = (math.degrees(math.asin(numbers.uniform(-1, 1))), numbers.uniform(-180, 180), numbers.uniform(-500, 9000))
        reach = 10 ** numbers.uniform(0, 5)
        position = [numbers.uniform(-reach, reach), numbers.uniform(-reach, reach), numbers.uniform(-3000, 3000)]
        found.append([*datum, numbers.uniform(-math.pi, math.pi), *position])
    return found


def north_east_down(azimuth: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (x * math.cos(azimuth) - y * math.sin(azimuth), x * math.sin(azimuth) + y * math.cos(azimuth), z)


def by_pymap3d(datum: list[float], ned: tuple[float, float, float]) -> tuple[float, float, float]:
    return pymap3d.ned2geodetic(*ned, *datum)


def by_proj(datum: list[float], azimuth: float, place: tuple[float, ...]) -> list[float]:
    """The position of a place. The way back is a closed formula in PROJ, which is wrong by up to 2 micrometres."""
    latitude, longitude, height = datum
    topocentric = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={latitude!r} +lon_0={longitude!r} +h_0={height!r}"
    )
    east, north, up = topocentric.transform(place[1], place[0], place[2])
    sine, cosine = math.sin(azimuth), math.cos(azimuth)
    return [north * cosine + east * sine, east * cosine - north * sine, -up]


def apart(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    """The distance of two near places, m."""
    around = (one[1] - other[1] + 180) % 360 - 180
    return math.hypot((one[0] - other[0]) * DEGREE, around * DEGREE * math.cos(math.radians(one[0])), one[2] - other[2])


def main() -> None:
    asked = flights(FLIGHTS)
    places = [tuple(map(float, by_pymap3d(flight[:3], north_east_down(*flight[3:])))) for flight in asked]
    lines = [" ".join(map(repr, [*flight, *place])) for flight, place in zip(asked, places)]
    done = subprocess.run([sys.argv[1]], input="\n".join(lines) + "\n", capture_output=True, text=True, check=True)
    answers = [tuple(map(float, line.split())) for line in done.stdout.splitlines()]
    assert len(answers) == len(asked) == FLIGHTS
    ways = ["place of a position", "position of a place"]
    errors = dict.fromkeys([f"{way}, {library}" for way in ways for library in ("pymap3d", "PROJ")], 0.0)
    for flight, place, answer in zip(asked, places, answers):
        datum, azimuth, position = flight[:3], flight[3], flight[4:]
        found = [
            apart(place, answer[:3]),
            math.dist(position, by_proj(datum, azimuth, answer[:3])),
            math.dist(position, answer[3:]),
            math.dist(by_proj(datum, azimuth, place), answer[3:]),
        ]
        errors = {what: max(error, new) for (what, error), new in zip(errors.items(), found)}
    for what, error in errors.items():
        print(f"{what}: {FLIGHTS} compared, {error * 1e9:.1f} nm apart at most")
    assert all(error < LIMIT for error in errors.values()), errors


main()
