"""A control law in CasADi, which differentiates the desired thrust axis along the path and writes the law as C.

    python3 -m pip install casadi==3.8.2
    python3 law.py        # writes law.c and law.h
"""
import casadi as ca

names = {"position": 3, "world_from_body": 9, "velocity_body": 3, "thrust": 1, "desired": 3, "derivative1": 3,
         "derivative2": 3, "derivative3": 3, "rates": 2, "yaw": 1, "gains": 4}
inputs = {name: ca.SX.sym(name, size) for name, size in names.items()}
p, rows, v, T, pd, d1, d2, d3, rates, yaw, gains = inputs.values()
kp, kv, kr, mass = ca.vertsplit(gains)
R = ca.reshape(rows, 3, 3).T
down, t = ca.DM([0, 0, 9.81]), ca.SX.sym("t")

# The path and the vehicle a moment t ahead: Taylor series, with constant acceleration of gamma and constant thrust.
way = rates[0] * t + rates[1] * t**2 / 2
path = pd + d1 * way + d2 * way**2 / 2 + d3 * way**3 / 6
velocity = R @ v
vehicle = p + velocity * t + (down - T / mass * R[:, 2]) * t**2 / 2
path_velocity, vehicle_velocity = ca.jacobian(path, t), ca.jacobian(vehicle, t)
acceleration = ca.jacobian(path_velocity, t) - kp * (vehicle - path) - kv * (vehicle_velocity - path_velocity)
force = mass * (down - acceleration)
axis = force / ca.norm_2(force)
now = lambda expression: ca.substitute(expression, t, 0)
desired, turning = now(axis), now(ca.jacobian(axis, t))

# The thrust axis turns with the desired one, and to it.
omega = R.T @ (ca.cross(desired, turning) + kr * ca.cross(R[:, 2], desired))
yaw_error = ca.atan2(R[1, 0], R[0, 0]) - yaw
command = ca.vertcat(ca.fmax(0, ca.dot(now(force), R[:, 2])), omega[0], omega[1], -2 * ca.sin(yaw_error))
law = ca.Function("law", list(inputs.values()), [command], list(inputs), ["command"])
law.generate("law.c", {"with_header": True, "casadi_int": "int"})
