"""Prints how many vehicle steps a second MuJoCo makes, in C on all cores: a rigid body with four thrusts, RK4 at 1 kHz."""

import os
import time

import mujoco
import numpy as np
from mujoco import rollout

MODEL = """
<mujoco>
  <option timestep="0.001" integrator="RK4"/>
  <worldbody>
    <body name="vehicle" pos="0 0 1">
      <freejoint/>
      <inertial pos="0 0 0" mass="0.2" diaginertia="6.5e-4 6.5e-4 13e-4"/>
      <site name="a" pos="0.1 0 0"/> <site name="b" pos="0 0.1 0"/>
      <site name="c" pos="-0.1 0 0"/> <site name="d" pos="0 -0.1 0"/>
    </body>
  </worldbody>
  <actuator>
    <motor site="a" gear="0 0 1 0 0 0.01"/> <motor site="b" gear="0 0 1 0 0 -0.01"/>
    <motor site="c" gear="0 0 1 0 0 0.01"/> <motor site="d" gear="0 0 1 0 0 -0.01"/>
  </actuator>
</mujoco>
"""
FLIGHTS, STEPS = 16, 10_000

threads = len(os.sched_getaffinity(0))
model = mujoco.MjModel.from_xml_string(MODEL)
datas = [mujoco.MjData(model) for _ in range(threads)]
size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
start = np.zeros(size)
mujoco.mj_getState(model, datas[0], start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
thrusts = np.full((FLIGHTS, STEPS, model.nu), 0.2 * 9.81 / 4)
begun = time.perf_counter()
rollout.rollout(model, datas, np.tile(start, (FLIGHTS, 1)), thrusts)
print(FLIGHTS * STEPS / (time.perf_counter() - begun))
