"""Compares the delay and the lag of `gerono identify` with fits of SciPy, over flights with random delays.

    delay.py GERONO SCENARIO FLIGHTS FOLDER

Every other flight is a hover. `scipy.optimize.least_squares` fits delay d and lag T of the body rates about x and y to

    T dw/dt = u(t - d) - w,

where u are the commanded rates of the log, held from frame to frame. It fits them to the true rates of the simulation, which must
return what was set, and to the rotation between neighbouring captures, which is all that a laboratory has. Only captures and
commands that are older enter a prediction, so that the feedback of their noise makes no bias. The standard error of the second
fit follows from the scatter of fits to ten parts of the flight. Fails if `gerono identify` is farther from the truth than its
interval in more than one flight of ten, or differs from the second fit by more than both intervals allow.
"""

import csv
import io
import json
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

TICK = 1e-3  # s
PARTS = 10
DURATION = 25.0  # s


def columns(gerono, log, topic, names):
    """Returns columns of a topic as arrays."""
    command = [gerono, "export", str(log), "--csv", "--topic", topic]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    rows = [row for row in csv.DictReader(io.StringIO(text)) if row.get("tracked", "true") == "true"]
    return np.array([[float(row[name]) for name in names] for row in rows])


def commanded(frames, times, delay, lag):
    """Returns the rates on a grid that starts at 0, for commands that act `delay` later, with a first-order lag."""
    index = np.searchsorted(frames[:, 0] + delay, times, side="right") - 1
    held = np.where(index[:, None] < 0, 0.0, frames[np.maximum(index, 0), 1:])
    # A command that begins to act within a step acts for a part of it.
    begins = np.maximum(index, 0)
    share = np.clip((times - frames[begins, 0] - delay) / TICK, 0.0, 1.0)[:, None]
    before = np.where(index[:, None] < 1, 0.0, frames[np.maximum(index - 1, 0), 1:])
    held = share * held + (1.0 - share) * before
    decay = np.exp(-TICK / lag)
    return lfilter([1.0 - decay], [1.0, -decay], held, axis=0)


def fitted(frames, times, measured, predicted):
    """Fits delay and lag; `predicted` turns rates on the grid into what was measured."""

    def residuals(parameters, part=slice(None)):
        return (measured - predicted(commanded(frames, times, *parameters)))[part].ravel()

    bounds = ([0.0, 2e-3], [0.06, 0.08])
    settings = {"bounds": bounds, "x_scale": [1e-2, 1e-2], "diff_step": 0.05}
    whole = least_squares(residuals, [0.015, 0.02], **settings).x
    return whole, residuals, settings


def parts_of(whole, residuals, settings, count):
    """Returns the half-widths of 95 % of delay, lag and their sum, from one Gauss-Newton step in each part."""
    step = 2e-3
    jacobian = []
    for index in range(2):
        change = np.zeros(2)
        change[index] = step
        jacobian.append((residuals(whole + change) - residuals(whole - change)) / (2 * step))
    jacobian, rest = np.array(jacobian).T, residuals(whole)
    information = np.linalg.inv(jacobian.T @ jacobian)
    scores = [j.T @ r for j, r in zip(np.array_split(jacobian, PARTS), np.array_split(rest, PARTS))]
    spread = sum(np.outer(score, score) for score in scores) * PARTS / (PARTS - 2)
    covariance = information @ spread @ information
    total = covariance.sum()
    quantile = student.ppf(0.975, PARTS - 2)
    return quantile * np.sqrt([covariance[0, 0], covariance[1, 1], total])


def main():
    gerono, scenario, flights, folder = sys.argv[1], sys.argv[2], int(sys.argv[3]), Path(sys.argv[4])
    draw = random.Random(1)
    missed, differing = [], []
    print("flight  true d, T, sum     SciPy on truth   gerono identify          SciPy on captures, ms")
    for flight in range(1, flights + 1):
        delay = round(draw.uniform(3.0, 17.0)) * 1e-3
        lag = draw.uniform(0.01, 0.028)
        log = folder / f"flight{flight}"
        settings = [
            f"seed={flight}",
            f"duration={DURATION}",
            "vehicle.change=[]",
            f'schedule.latency."rc/frame -> plant"={delay}',
            f"vehicle.actuators.rate_lag=[{lag}, {lag}, {lag}]",
        ]
        if flight % 2:
            settings.append("path.curve={hover={position=[0.0, 0.0, -1.0]}}")
        sets = [word for setting in settings for word in ("--set", setting)]
        run = [gerono, "run", scenario, "--host", "inprocess", "--quiet", "--out", str(log), *sets]
        subprocess.run(run, check=True)
        found = json.loads(subprocess.run([gerono, "identify", str(log), "--json"], check=True, capture_output=True).stdout)
        answer = found["answer"]
        rates = ["rates_body.0", "rates_body.1"]
        frames = columns(gerono, log, "rc/frame", ["header.stamp_ns", *rates])
        frames[:, 0] *= 1e-9
        truth = columns(gerono, log, "vehicle/truth", ["header.stamp_ns", "angular_velocity_body.0", "angular_velocity_body.1"])
        times = truth[:, 0] * 1e-9
        by_truth, *_ = fitted(frames, times, truth[:, 1:], lambda predicted: predicted)
        matrix = [f"world_from_body.{element}" for element in range(9)]
        poses = columns(gerono, log, "mocap/pose", ["capture_time_ns", *matrix])
        # The vehicle is far from the path at first.
        poses = poses[poses[:, 0] > 2e9]
        at = np.round(poses[:, 0] * 1e-9 / TICK).astype(int)
        turned = Rotation.from_matrix(poses[:, 1:].reshape(-1, 3, 3))
        lasted = np.diff(at) * TICK
        measured = (turned[:-1].inv() * turned[1:]).as_rotvec()[:, :2] / lasted[:, None]

        def mean_rates(predicted):
            angle = np.vstack([np.zeros(2), np.cumsum(predicted, axis=0)]) * TICK
            return (angle[at[1:]] - angle[at[:-1]]) / lasted[:, None]

        by_captures, residuals, options = fitted(frames, times, measured, mean_rates)
        widths = parts_of(by_captures, residuals, options, len(measured))
        is_true = np.array([delay, lag, delay + lag])
        names = ["radio_latency", "rate_lag", "to_rate"]
        ours = np.array([[answer[name]["found"], answer[name]["error"]] for name in names])
        theirs = np.array([*by_captures, by_captures.sum()])
        print(
            f"{flight:3}   "
            + "  ".join(f"{1e3 * value:6.2f}" for value in is_true)
            + "   "
            + " ".join(f"{1e3 * value:6.2f}" for value in by_truth)
            + "   "
            + " ".join(f"{1e3 * value:6.2f}±{1e3 * error:.2f}" for value, error in ours)
            + "   "
            + " ".join(f"{1e3 * value:6.2f}±{1e3 * error:.2f}" for value, error in zip(theirs, widths))
        )
        missed += [name for name, is_wrong in zip(names, abs(ours[:, 0] - is_true) > ours[:, 1]) if is_wrong]
        apart = abs(ours[:, 0] - theirs) > np.hypot(ours[:, 1], widths)
        differing += [name for name, is_apart in zip(names, apart) if is_apart]
    print(f"{len(missed)} of {3 * flights} intervals miss the truth; {len(differing)} of {3 * flights} fits differ")
    if max(len(missed), len(differing)) > max(1, 0.1 * 3 * flights):
        sys.exit(f"too many: {missed} {differing}")


main()
