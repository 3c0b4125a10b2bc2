"""The law `geometric_pid` again: tests/plugins/geometric_pid.c has the same sums in the same order."""

import math

import gerono
from gerono.math import atan2

G, KP, KV, KI, KR, LIMIT, MASS, STEP = 9.81, 36.0, 12.0, 18.0, 39.24, 9.0, 0.2, 0.001
YAW_KP, YAW_KI, YAW_LIMIT = 4.0, 0.5, 0.5


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    return [a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3] for i in range(3)]


def clamp(x, limit):
    return min(max(x, -limit), limit)


class GeometricPid(gerono.Controller):
    def __init__(self):
        self.x = self.y = self.z = self.roll = self.pitch = self.yaw_integral = 0.0

    def step(self, now, state, reference, command, errors):
        elapsed = now.elapsed or STEP
        R, v = state["world_from_body"].tolist(), state["velocity_body"].tolist()
        rate, turn = float(reference["gamma_dot"]), float(reference["gamma_ddot"])
        d1, d2, d3 = (reference[f"derivative{order}_world"].tolist() for order in (1, 2, 3))
        p, pd = state["position_world"].tolist(), reference["position_world"].tolist()
        n = [R[i][2] for i in range(3)]
        e = [p[i] - pd[i] for i in range(3)]
        de = [dot(R[i], v) - d1[i] * rate for i in range(3)]
        ahead = [d2[i] * (rate * rate) + d1[i] * turn for i in range(3)]
        gravity, integral = [0.0, 0.0, G], [self.x, self.y, self.z]
        integral = [clamp(integral[i] + (de[i] + e[i] * (2.0 * KP / KV)) * (KI * elapsed), LIMIT) for i in range(3)]
        self.x, self.y, self.z = integral
        f = [gravity[i] - (ahead[i] - KV * de[i] - KP * e[i]) + integral[i] for i in range(3)]
        thrust = MASS * dot(n, f)
        df = []
        for i in range(3):
            jerk = d3[i] * (rate * rate * rate) + d2[i] * (3.0 * rate * turn) + d1[i] * float(reference["gamma_dddot_constant"])
            df.append(-jerk + KV * (gravity[i] - n[i] * (thrust / MASS) - ahead[i]) + KP * de[i])
        if f[2] < 0.3 * G:
            f[2], df[2] = 0.3 * G, 0.0
        size = math.sqrt(dot(f, f))
        nd = [f[i] / size for i in range(3)]
        radial = dot(nd, df)
        along = cross(nd, [(df[i] - nd[i] * radial) / size for i in range(3)])
        across = cross(n, nd)
        sine = math.sqrt(dot(across, across))
        share = atan2(sine, dot(n, nd)) / sine if sine > 0.0 else 0.0
        omega = [across[i] * share * KR + along[i] for i in range(3)]
        roll, pitch = (dot([R[0][i], R[1][i], R[2][i]], omega) for i in range(2))
        yaw = atan2(R[1][0], R[0][0]) - float(reference["yaw"])
        yaw -= 2.0 * math.pi * round(yaw / (2.0 * math.pi))
        proportional = YAW_KP * yaw
        rates = (0.0 + (self.roll + roll) * 0.5, 0.0 + (self.pitch + pitch) * 0.5, 0.0 + (-proportional - self.yaw_integral))
        self.roll, self.pitch = roll, pitch
        if abs(proportional) <= YAW_LIMIT:
            self.yaw_integral += YAW_KI * yaw * elapsed
        self.yaw_integral = clamp(self.yaw_integral, YAW_LIMIT)
        command["thrust"], command["rates_body"] = thrust, rates
