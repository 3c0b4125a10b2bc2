"""Judges the noise of a simulated inertial measurement unit at rest by its Allan deviation, which allantools computes.

    allan.py SAMPLES RATE STATED

SAMPLES holds three rates and three specific forces a sample as little-endian numbers of 8 bytes, RATE is in Hz, and STATED has
a line of JSON for each of the two sensors.
"""

import json
import sys

import allantools
import numpy

samples = numpy.fromfile(sys.argv[1], dtype="<f8").reshape(-1, 6)
rate = float(sys.argv[2])
duration = len(samples) / rate
with open(sys.argv[3], encoding="utf-8") as lines:
    stated = [json.loads(line) for line in lines]
assert [sensor["sensor"] for sensor in stated] == ["gyroscope", "accelerometer"]

# White noise alone, both, the bias walk alone.
taus = numpy.array([0.1, 1.0, 10.0, 100.0])
status = 0
for number, sensor in enumerate(stated):
    axes = []
    for signal in samples[:, 3 * number : 3 * number + 3].T:
        found, deviations, _, _ = allantools.oadev(signal, rate=rate, data_type="freq", taus=taus)
        assert numpy.allclose(found, taus)
        axes.append(deviations)
    measured = numpy.sqrt(numpy.mean(numpy.square(axes), axis=0))
    # Rounding to the resolution is white noise too.
    white = sensor["noise_density"] ** 2 + sensor["resolution"] ** 2 / 12 / rate
    expected = numpy.sqrt(white / taus + sensor["bias_walk"] ** 2 * taus / 3)
    # Three times the error of a deviation out of as many independent spans.
    tolerance = 3 / numpy.sqrt(2 * 3 * duration / taus)
    for tau, value, should_be, most in zip(taus, measured, expected, tolerance):
        ratio = value / should_be
        is_right = abs(ratio - 1) < most
        status |= not is_right
        print(f"{sensor['sensor']:13} {tau:6.1f} s: {value:.3e}, stated {should_be:.3e}, ratio {ratio:.3f} ± {most:.3f}"
              f"{'' if is_right else '  WRONG'}")
sys.exit(status)
