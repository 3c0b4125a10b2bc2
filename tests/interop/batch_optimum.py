"""Compares inertial navigation with the optimum that gtsam finds for the same samples of simulated flights.

    batch_optimum.py GERONO SCENARIO FLIGHTS FOLDER

The graph has the motion and the biases of gyroscope and accelerometer at each measured field, every 20 ms, and at each fix the slow
errors of fixes, of the field and of the altitude. It is told the noises that the filter is told by [navigation], and that the
vehicle rests until its motors start; no estimate of the filter. Its first guess is of fixes and of the gyroscope alone.

* The batch optimum uses all samples up to the landing, so also those that follow: the limit.
* The causal optimum uses the samples up to a fix, in a batch for each; the inertial samples since propagate it to the present,
  0.12 s to 0.22 s later, as with the filter. This is the most that a filter can know.

FLIGHTS flights have only the errors of the sensors that the filter models, with their true noises, and as many have all errors and
the scenario's noises. Errors are roots of mean squares of the whole vector over the same times of all these flights, every 2 s from
25 s on to the landing.

Prints a table, and fails
* if the errors of the batch optimum, of modelled errors, are not those that its own covariance states: the graph would be wrong;
* if the filter errs less than this optimum;
* if velocity or position of the filter err more than the causal optimum by more than a tenth.
"""

import csv
import io
import json
import math
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, S, V, X
from mcap.reader import make_reader

GRAVITY = 9.81  # m/s², of the simulation
FROM_NS = 25_000_000_000
# Age at which the filter fuses a fix.
HORIZON_NS = 120_000_000
# Number of fixes from one causal optimum to the next.
EVERY = 20
# Of the velocity of a vehicle at rest, m/s, as in the filter; and of its turn from fix to fix, rad.
REST_DEVIATION = 0.01
REST_TURN = 1e-5
# Height below which the air below the rotors is compressed, m, as in the filter.
NEAR_THE_GROUND = 1.0

# Most that the filter may err over the causal optimum.
MOST_OVER_OPTIMUM = 1.1
# Most that the batch optimum may err over the filter: chance.
MOST_OVER_FILTER = 1.05
# Independent errors of velocity, attitude (of the heading, which is constant) and position in a flight.
INDEPENDENT = np.array([50, 1, 5])

# Rows of the slow errors: of fixes (position and velocity), of the field, of the altitude.
FIX_POSITION, FIX_VELOCITY, FIELD, ALTITUDE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 10)
SLOW = 10

ONLY_MODELLED = [
    "sensors.imu={gyroscope_scale=0.0, accelerometer_scale=0.0, gyroscope_sensitivity=0.0, vibration=[0.0, 0.0]}",
    "sensors.barometer={airspeed_factor=0.0, ground_effect=0.0}",
    "sensors.magnetometer={soft_iron=0.0, current=[0.0, 0.0, 0.0]}",
    # Rounding to the resolution of 1 mG is white noise too.
    f"navigation.field_white={math.hypot(0.003, 0.001 / math.sqrt(12.0))}",
    "navigation.field_walk=0.0",
    "navigation.field_bias=0.01",
    "navigation.field_arming=0.0",
    "navigation.altitude_ground_effect=0.0",
]


def skew(v):
    """Returns S(v), by which S(v) w = v × w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def columns(gerono, log, topic, names, *, unless=None):
    """Returns columns of a topic as an array, without samples whose flag `unless` is set or that measured nothing."""
    command = [gerono, "export", str(log), "--csv", "--topic", topic]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    rows = (row for row in csv.DictReader(io.StringIO(text)) if row.get("measured", "true") == "true")
    rows = (row for row in rows if unless is None or row[unless] == "false")
    return np.array([[float(row[name]) for name in names] for row in rows])


def of(name, count=3):
    """Returns the names of the columns of a vector."""
    return [f"{name}.{index}" for index in range(count)]


def stated(log):
    """Returns the scenario of a log."""
    with open(log / "run.mcap", "rb") as stream:
        manifest = next(metadata for metadata in make_reader(stream).iter_metadata() if metadata.name == "gerono")
    return json.loads(manifest.metadata["scenario"], object_hook=lambda members: SimpleNamespace(**members))


def ecef(latitude, longitude, height):
    """Returns earth-centred coordinates (m) of degrees and a height above the ellipsoid of WGS-84."""
    flattening = 1.0 / 298.257223563
    squared = flattening * (2.0 - flattening)
    phi, lam = np.radians(latitude), np.radians(longitude)
    radius = 6378137.0 / np.sqrt(1.0 - squared * np.sin(phi) ** 2)
    across = (radius + height) * np.cos(phi)
    return np.stack([across * np.cos(lam), across * np.sin(lam), (radius * (1.0 - squared) + height) * np.sin(phi)], axis=-1)


def world_from_ned(datum):
    """Returns {I} from north, east and down at the datum."""
    cosine, sine = np.cos(datum.azimuth), np.sin(datum.azimuth)
    return np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def to_world(datum, geodetic):
    """Returns places (degrees, degrees, m) in {I}, m."""
    phi, lam = np.radians(datum.latitude), np.radians(datum.longitude)
    north = [-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)]
    east = [-np.sin(lam), np.cos(lam), 0.0]
    down = [-np.cos(phi) * np.cos(lam), -np.cos(phi) * np.sin(lam), -np.sin(phi)]
    away = ecef(*geodetic.T) - ecef(datum.latitude, datum.longitude, datum.height)
    return away @ np.array([north, east, down]).T @ world_from_ned(datum).T


def by_time(rows, end_ns):
    """Returns rows by the time in their first column, ns, up to an end."""
    return {int(row[0]): row[1:] for row in rows if row[0] <= end_ns}


def read(gerono, log):
    """Returns what the graph needs of a flight, with the truth and the estimate to compare with."""
    scenario = stated(log)
    end_ns = round(scenario.flight.land_at * 1e9)
    fixes = columns(gerono, log, "gnss/fix", ["valid_ns", "latitude", "longitude", "height", *of("velocity_ned")])
    positions = to_world(scenario.datum, fixes[:, 1:4])
    velocities = fixes[:, 4:] @ world_from_ned(scenario.datum).T
    frames = columns(gerono, log, "rc/frame", ["header.stamp_ns"], unless="failsafe")
    kept = ["position_world", "velocity_body"]
    motion = [name for vector in kept for name in of(vector)] + of("world_from_body", 9)
    return SimpleNamespace(
        assumed=scenario.navigation,
        field_world=world_from_ned(scenario.datum) @ scenario.datum.field,
        end_ns=end_ns,
        starts_ns=int(frames[0, 0]),
        imu=columns(gerono, log, "imu/sample", ["measured_ns", *of("angular_velocity_body"), *of("specific_force_body")]),
        fixes=by_time(np.hstack([fixes[:, :1], positions, velocities]), end_ns),
        fields=by_time(columns(gerono, log, "mag/field", ["measured_ns", *of("field_body")]), end_ns),
        altitudes=by_time(columns(gerono, log, "baro/altitude", ["measured_ns", "altitude"]), end_ns),
        truth=columns(gerono, log, "vehicle/truth", ["header.stamp_ns", *motion]),
        state=columns(gerono, log, "vehicle/state", ["state_time_ns", *motion]),
    )


def axes(down, across):
    """Returns a right-handed triad along a direction, with the second direction in its first and third axis."""
    down = down / np.linalg.norm(down)
    east = np.cross(down, across)
    east /= np.linalg.norm(east)
    return np.column_stack([np.cross(east, down), east, down])


def rotations(vectors):
    """Returns exp S(v) of each row."""
    return np.array([gtsam.Rot3.Expmap(vector).matrix() for vector in vectors])


class Graph:
    """Factors of a flight and their first guess, from state to state."""

    def __init__(self, flight):
        assert flight.fixes.keys() | flight.altitudes.keys() <= flight.fields.keys(), "a measurement has no state"
        self.flight = flight
        self.errors = flight.assumed.rtk_fixed
        self.antenna = np.array(flight.assumed.antenna)
        at_rest = flight.imu[:, 0] <= flight.starts_ns
        self.gyroscope_bias = flight.imu[at_rest, 1:4].mean(axis=0)
        self.bias_hat = gtsam.imuBias.ConstantBias(np.zeros(3), self.gyroscope_bias)
        force = flight.imu[at_rest, 4:].mean(axis=0)
        field = np.mean([field for time, field in flight.fields.items() if time <= flight.starts_ns], axis=0)
        at_start = axes(np.array([0.0, 0.0, 1.0]), flight.field_world) @ axes(-force, field).T
        self.times_ns = sorted(time for time in flight.fields if time >= min(flight.fixes))
        self.fix_times_ns = np.array(sorted(flight.fixes))
        self.ground_z = np.mean([fix[2] for time, fix in flight.fixes.items() if time <= flight.starts_ns])
        self.prepare_imu(at_start)
        self.prepare_motion()

    def prepare_imu(self, at_start):
        """Turns each specific force to the attitude at the beginning of its sample, where gtsam expects it; it is that in the middle."""
        imu = self.flight.imu
        self.imu_ns = imu[:, 0].astype(int)
        self.spans = np.diff(self.imu_ns, prepend=0) * 1e-9
        turns = (imu[:, 1:4] - self.gyroscope_bias) * self.spans[:, None]
        self.forces = np.einsum("nij,nj->ni", rotations(0.5 * turns), imu[:, 4:])
        attitude = gtsam.Rot3(at_start)
        self.attitudes = []
        for turn in turns:
            attitude = attitude.compose(gtsam.Rot3.Expmap(turn))
            self.attitudes.append(attitude)

    def prepare_motion(self):
        """Makes the first guess: fixes, and attitudes by the gyroscope alone."""
        fixes = np.array([self.flight.fixes[time] for time in self.fix_times_ns])
        self.guesses = {}
        for time in self.times_ns:
            motion = [np.interp(time, self.fix_times_ns, column) for column in fixes.T]
            attitude = self.attitudes[max(np.searchsorted(self.imu_ns, time, side="right") - 1, 0)]
            position = np.array(motion[:3]) - attitude.matrix() @ self.antenna
            self.guesses[time] = gtsam.Pose3(attitude, position), np.array(motion[3:])

    def parameters(self):
        """Returns the noises of the inertial measurement unit."""
        assumed = self.flight.assumed
        parameters = gtsam.PreintegrationCombinedParams.MakeSharedD(GRAVITY)
        for set_covariance, deviation in [
            (parameters.setAccelerometerCovariance, assumed.accelerometer_noise),
            (parameters.setGyroscopeCovariance, assumed.gyroscope_noise),
            (parameters.setBiasAccCovariance, assumed.accelerometer_walk),
            (parameters.setBiasOmegaCovariance, assumed.gyroscope_walk),
            (parameters.setIntegrationCovariance, 1e-7),
        ]:
            set_covariance(np.eye(3) * deviation**2)
        return parameters

    def preintegrated(self, since_ns, until_ns, bias):
        """Returns the samples between two times in one."""
        samples = gtsam.PreintegratedCombinedMeasurements(self.parameters(), bias)
        first, last = np.searchsorted(self.imu_ns, [since_ns, until_ns], side="right")
        for index in range(first, last):
            samples.integrateMeasurement(self.forces[index], self.flight.imu[index, 1:4], self.spans[index])
        return samples

    def propagated(self, state, bias, time_ns, from_ns, to_ns):
        """Returns the motion at the inertial samples of a span after a state, by these samples alone."""
        wanted = [time for time in self.imu_ns if from_ns <= time < to_ns]
        return [(time, self.preintegrated(time_ns, time, bias).predict(state, bias)) for time in wanted]

    def steps(self):
        """Returns time, factors and new variables of each state in turn."""
        for number, time in enumerate(self.times_ns):
            factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            pose, velocity = self.guesses[time]
            values.insert(X(number), pose)
            values.insert(V(number), velocity)
            values.insert(B(number), self.bias_hat)
            if number == 0:
                self.add_start(factors, pose)
            else:
                before_ns = self.times_ns[number - 1]
                samples = self.preintegrated(before_ns, time, self.bias_hat)
                keys = X(number - 1), V(number - 1), X(number), V(number), B(number - 1), B(number)
                factors.add(gtsam.CombinedImuFactor(*keys, samples))
                if time <= self.flight.starts_ns:
                    self.add_rest(factors, number)
            slow = int(np.searchsorted(self.fix_times_ns, time, side="right")) - 1
            if time in self.flight.fixes:
                values.insert(S(slow), np.zeros(SLOW))
                self.add_slow(factors, slow)
                self.add_fix(factors, number, slow, time)
            self.add_field(factors, number, slow, time)
            self.add_altitude(factors, number, slow, time)
            yield time, factors, values

    def add_start(self, factors, pose):
        assumed = self.flight.assumed
        loose = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([1.0, 10.0], 3))
        factors.add(gtsam.PriorFactorPose3(X(0), pose, loose))
        still = gtsam.noiseModel.Isotropic.Sigma(3, REST_DEVIATION)
        factors.add(gtsam.PriorFactorPoint3(V(0), np.zeros(3), still))
        biases = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([assumed.accelerometer_bias, assumed.gyroscope_bias], 3))
        factors.add(gtsam.PriorFactorConstantBias(B(0), gtsam.imuBias.ConstantBias(), biases))

    def add_rest(self, factors, number):
        """Adds that the vehicle neither moves nor turns, at every fix."""
        time = self.times_ns[number]
        if time not in self.flight.fixes:
            return
        before = self.times_ns.index(max(fix for fix in self.flight.fixes if fix < time))
        still = gtsam.noiseModel.Isotropic.Sigma(3, REST_DEVIATION)
        factors.add(gtsam.PriorFactorPoint3(V(number), np.zeros(3), still))
        same = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([REST_TURN, 1e3], 3))
        factors.add(gtsam.BetweenFactorPose3(X(before), X(number), gtsam.Pose3(), same))

    def add_slow(self, factors, slow):
        """Adds how the slow errors follow from those at the fix before."""
        assumed, errors = self.flight.assumed, self.errors
        stationary = np.zeros(SLOW)
        stationary[FIX_POSITION] = errors.position_slow * np.array([1.0, 1.0, errors.vertical_factor])
        stationary[FIX_VELOCITY] = errors.velocity_slow
        if slow == 0:
            stationary[FIELD], stationary[ALTITUDE] = assumed.field_bias, assumed.altitude_bias
            model = gtsam.noiseModel.Diagonal.Sigmas(stationary)
            factors.add(gtsam.PriorFactorVector(S(0), np.zeros(SLOW), model))
            return
        before_ns, now_ns = self.fix_times_ns[slow - 1 : slow + 1]
        h = (now_ns - before_ns) * 1e-9
        remain = np.ones(SLOW)
        remain[FIX_POSITION], remain[FIX_VELOCITY] = np.exp(-h / errors.position_time), np.exp(-h / errors.velocity_time)
        deviations = stationary * np.sqrt(1.0 - remain**2)
        # A variable without a walk still needs a noise.
        deviations[FIELD] = max(assumed.field_walk * np.sqrt(h), 1e-6)
        if before_ns < self.flight.starts_ns <= now_ns:
            deviations[FIELD] = np.hypot(deviations[FIELD], assumed.field_arming)
        deviations[ALTITUDE] = assumed.altitude_walk * np.sqrt(h)
        model = gtsam.noiseModel.Diagonal.Sigmas(deviations)
        linear = gtsam.JacobianFactor(S(slow - 1), -np.diag(remain), S(slow), np.eye(SLOW), np.zeros(SLOW), model)
        origin = gtsam.Values()
        origin.insert(S(slow - 1), np.zeros(SLOW))
        origin.insert(S(slow), np.zeros(SLOW))
        factors.add(gtsam.LinearContainerFactor(linear, origin))

    def add_fix(self, factors, number, slow, time):
        """Adds position and velocity of the antenna."""
        errors, arm, measured = self.errors, self.antenna, self.flight.fixes[time]
        index = max(np.searchsorted(self.imu_ns, time, side="right") - 1, 0)
        swing = np.cross(self.flight.imu[index, 1:4] - self.gyroscope_bias, arm)
        of_position, of_velocity = np.zeros((3, SLOW)), np.zeros((3, SLOW))
        of_position[:, FIX_POSITION] = of_velocity[:, FIX_VELOCITY] = np.eye(3)

        def position(factor, values, derivatives):
            pose, slow_errors = values.atPose3(X(number)), values.atVector(S(slow))
            turned = pose.rotation().matrix()
            if derivatives is not None:
                derivatives[0] = np.hstack([-turned @ skew(arm), turned])
                derivatives[1] = of_position
            return pose.translation() + turned @ arm + slow_errors[FIX_POSITION] - measured[:3]

        def velocity(factor, values, derivatives):
            turned, slow_errors = values.atPose3(X(number)).rotation().matrix(), values.atVector(S(slow))
            if derivatives is not None:
                derivatives[0] = np.hstack([-turned @ skew(swing), np.zeros((3, 3))])
                derivatives[1] = np.eye(3)
                derivatives[2] = of_velocity
            return values.atPoint3(V(number)) + turned @ swing + slow_errors[FIX_VELOCITY] - measured[3:]

        white = errors.position_white * np.array([1.0, 1.0, errors.vertical_factor])
        model = gtsam.noiseModel.Diagonal.Sigmas(white)
        factors.add(gtsam.CustomFactor(model, [X(number), S(slow)], position))
        model = gtsam.noiseModel.Isotropic.Sigma(3, errors.velocity_white)
        factors.add(gtsam.CustomFactor(model, [X(number), V(number), S(slow)], velocity))

    def add_field(self, factors, number, slow, time):
        earth, measured = self.flight.field_world, self.flight.fields[time]
        of_field = np.zeros((3, SLOW))
        of_field[:, FIELD] = np.eye(3)

        def field(factor, values, derivatives):
            seen = values.atPose3(X(number)).rotation().matrix().T @ earth
            if derivatives is not None:
                derivatives[0] = np.hstack([skew(seen), np.zeros((3, 3))])
                derivatives[1] = of_field
            return seen + values.atVector(S(slow))[FIELD] - measured

        model = gtsam.noiseModel.Isotropic.Sigma(3, self.flight.assumed.field_white)
        factors.add(gtsam.CustomFactor(model, [X(number), S(slow)], field))

    def add_altitude(self, factors, number, slow, time):
        """Adds an altitude, unless the air below the rotors may be compressed."""
        if time not in self.flight.altitudes:
            return
        height = self.ground_z - self.guesses[time][0].translation()[2]
        if time > self.flight.starts_ns and height < NEAR_THE_GROUND:
            return
        measured = self.flight.altitudes[time]
        of_altitude = np.zeros((1, SLOW))
        of_altitude[:, ALTITUDE] = 1.0

        def altitude(factor, values, derivatives):
            pose = values.atPose3(X(number))
            if derivatives is not None:
                derivatives[0] = np.hstack([np.zeros((1, 3)), -pose.rotation().matrix()[2:]])
                derivatives[1] = of_altitude
            return values.atVector(S(slow))[ALTITUDE] - pose.translation()[2] - measured

        model = gtsam.noiseModel.Isotropic.Sigma(1, self.flight.assumed.altitude_white)
        factors.add(gtsam.CustomFactor(model, [X(number), S(slow)], altitude))


def optimum(factors, values):
    """Returns the variables with the least error, by Gauss-Newton steps of gtsam.

    Its Levenberg-Marquardt finds the same, but copies all variables for each error that is computed in Python.
    """
    ordering = gtsam.Ordering.ColamdNonlinearFactorGraph(factors)
    error = factors.error(values)
    for _ in range(20):
        values = values.retract(factors.linearize(values).optimize(ordering))
        before, error = error, factors.error(values)
        if abs(before - error) < 1e-6 * before:
            return values
    raise RuntimeError(f"no optimum: the error is still {error} after {before}")


def motion_at(values, number):
    """Returns the motion of a state."""
    return gtsam.NavState(values.atPose3(X(number)), values.atPoint3(V(number)))


def batch(graph):
    """Returns the motion at all times by all samples, and the errors that its covariance states."""
    factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for _, more, new in graph.steps():
        factors.push_back(more)
        values.insert(new)
    values = optimum(factors, values)
    marginals = gtsam.Marginals(factors, values)
    variances = []
    for number, time in enumerate(graph.times_ns):
        if time in graph.flight.fixes and FROM_NS <= time:
            turn, place = np.split(np.diag(marginals.marginalCovariance(X(number))), 2)
            variances.append([np.trace(marginals.marginalCovariance(V(number))), turn.sum(), place.sum()])
    motions = [(time, motion_at(values, number)) for number, time in enumerate(graph.times_ns)]
    return motions, np.sqrt(np.mean(variances, axis=0))


def causal(graph):
    """Returns the motion at present by the samples up to some fixes, until the filter fuses the fix that follows."""
    motions = []
    factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    period_ns = np.diff(graph.fix_times_ns).min()
    last_ns = graph.flight.end_ns - HORIZON_NS - period_ns
    instants = {time for time in graph.fix_times_ns[::EVERY] if FROM_NS <= time <= last_ns}
    for number, (time, more, new) in enumerate(graph.steps()):
        factors.push_back(more)
        values.insert(new)
        if time not in instants:
            continue
        values = optimum(factors, values)
        state, bias = motion_at(values, number), values.atConstantBias(B(number))
        present_ns = time + HORIZON_NS
        motions += graph.propagated(state, bias, time, present_ns, present_ns + period_ns)
    return motions


def errors_of(flight, times_ns, positions, velocities, attitudes):
    """Returns roots of mean squares of velocity (m/s), attitude (rad) and position (m)."""
    truth = flight.truth[np.searchsorted(flight.truth[:, 0], times_ns)]
    assert (truth[:, 0] == times_ns).all()
    is_attitude = truth[:, 7:].reshape(-1, 3, 3)
    is_velocity = np.einsum("nij,nj->ni", is_attitude, truth[:, 4:7])
    between = np.einsum("nji,njk->nik", is_attitude, attitudes)
    turns = np.array([gtsam.Rot3.Logmap(gtsam.Rot3(rotation)) for rotation in between])
    differences = velocities - is_velocity, turns, positions - truth[:, 1:4]
    return np.array([np.sqrt(np.mean(np.sum(difference**2, axis=1))) for difference in differences])


def errors_of_motions(flight, motions):
    """Returns those of states of gtsam."""
    states = [state for _, state in motions]
    positions = np.array([state.position() for state in states])
    velocities = np.array([state.velocity() for state in states])
    attitudes = np.array([state.attitude().matrix() for state in states])
    return errors_of(flight, np.array([time for time, _ in motions]), positions, velocities, attitudes)


def errors_of_filter(flight, times_ns):
    """Returns those of the states that the filter publishes for these times, or up to 4 ms later."""
    state = flight.state[np.searchsorted(flight.state[:, 0], times_ns)]
    attitudes = state[:, 7:].reshape(-1, 3, 3)
    velocities = np.einsum("nij,nj->ni", attitudes, state[:, 4:7])
    return errors_of(flight, state[:, 0].astype(int), state[:, 1:4], velocities, attitudes)


def compare(flight):
    """Returns the errors of each estimate of a flight, at the times at which there is a causal one."""
    graph = Graph(flight)
    by_all, by_covariance = batch(graph)
    at_present = causal(graph)
    times_ns = {time for time, _ in at_present}
    return {
        "filter": errors_of_filter(flight, sorted(times_ns)),
        "causal optimum": errors_of_motions(flight, at_present),
        "batch optimum": errors_of_motions(flight, [motion for motion in by_all if motion[0] in times_ns]),
        "batch optimum, by its covariance": by_covariance,
    }


def flown(gerono, scenario, seed, settings, log):
    """Flies, and returns what the graph needs of the flight."""
    sets = [word for setting in settings for word in ("--set", setting)]
    run = [gerono, "run", scenario, "--seed", str(seed), "--host", "inprocess", "--quiet", "--out", str(log), *sets]
    subprocess.run(run, check=True, stdout=subprocess.DEVNULL)
    return read(gerono, log)


def faults(flights, modelled, everything):
    """Returns what is wrong with the errors of the estimates."""
    found = []
    ratio = np.square(modelled["batch optimum"] / modelled["batch optimum, by its covariance"])
    if not (abs(ratio - 1.0) < 3.0 * np.sqrt(2.0 / (INDEPENDENT * flights))).all():
        found.append(f"the mean squares of the batch optimum are {ratio} of what its covariance states")
    ratio = modelled["batch optimum"] / modelled["filter"]
    if not (ratio < MOST_OVER_FILTER).all():
        found.append(f"the batch optimum errs {ratio} times as much as the filter")
    for name, errors in [("modelled", modelled), ("all", everything)]:
        ratio = errors["filter"] / errors["causal optimum"]
        if not (ratio[[0, 2]] < MOST_OVER_OPTIMUM).all():
            found.append(f"with {name} errors of the sensors the filter errs {ratio} times as much as the causal optimum")
    return found


def main():
    gerono, scenario, flights, folder = sys.argv[1], sys.argv[2], int(sys.argv[3]), Path(sys.argv[4])
    print("| errors of the sensors | estimate | velocity, cm/s | attitude, mrad | position, cm |")
    print("| --- | --- | --- | --- | --- |")
    found = []
    for name, settings in [("modelled", ONLY_MODELLED), ("all", [])]:
        seeds = range(1, flights + 1)
        each = [compare(flown(gerono, scenario, seed, settings, folder / f"{name}-{seed}")) for seed in seeds]
        together = {key: np.sqrt(np.mean([np.square(errors[key]) for errors in each], axis=0)) for key in each[0]}
        for estimate, errors in together.items():
            shown = " | ".join(f"{error:.2f}" for error in errors * [1e2, 1e3, 1e2])
            print(f"| {name} | {estimate} | {shown} |", flush=True)
        found.append(together)
    wrong = faults(flights, *found)
    if wrong:
        sys.exit("; ".join(wrong))


main()
