"""A hover controller that flies in place of Gerono's own: README.md beside it says more."""
import numpy as np

import gerono

MASS, INERTIA, WEIGHT = 0.2, np.array((6.5e-4, 6.5e-4, 13.0e-4)), np.array((0.0, 0.0, 0.2 * 9.81))  # kg, kg m², N
POSITION_GAIN, VELOCITY_GAIN, ATTITUDE_GAIN, RATE_GAIN = 4.0, 4.0, 225.0, 30.0  # 1/s², 1/s, 1/s², 1/s


class Hover(gerono.Controller):
    """Proportional and derivative, the attitude in SO(3); z points down."""

    def step(self, now, state, reference, command, errors):
        if state is None or reference is None or not state["tracked"]:
            command["mode"] = gerono.FAILSAFE
            return
        R = state["world_from_body"]
        error = state["position_world"] - reference["position_world"]
        velocity = R @ state["velocity_body"]
        x, y, z = R.T @ (MASS * (POSITION_GAIN * error + VELOCITY_GAIN * velocity) + WEIGHT)  # what T R e3 should be, in {B}
        length, yaw_error = np.sqrt(x * x + y * y + z * z), np.arctan2(R[1, 0], R[0, 0]) - reference["yaw"]
        turn = np.array((-y / length, x / length, -np.sin(yaw_error)))  # e3 to where the force shall point
        command["thrust"] = max(z, 0.0)
        command["torque_body"] = INERTIA * (ATTITUDE_GAIN * turn - RATE_GAIN * state["angular_velocity_body"])
        errors["z1"] = error


if __name__ == "__main__":
    import gerono.external

    gerono.external.fly(Hover())
