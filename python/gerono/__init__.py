"""Gerono: adaptive path following of a quadcopter, flown in this process.

    import gerono
    flight = gerono.Scenario("scenarios/fig1.toml").fly(seed=7, set={"controller.k1": 5.0})
    print(flight.summary.steady.rmse, flight.digest)
    z1 = flight["control/errors"]["z1"]  # m, a numpy array of shape (60001, 3)

`Scenario.fly` flies at once, `Scenario.start` step by step; `Controller` is the base class of controllers in Python;
`sweep` flies thousands of variants; `Log` reads the log of any flight. `gerono.gym` turns a scenario into a Gymnasium
environment, `gerono.external` a controller into a service of a running flight. Units are SI and rad.
"""

from gerono._gerono import ScenarioError, Snapshot, __version__
from gerono._samples import DTYPES
from gerono.controller import FAILSAFE, Controller, Now
from gerono.flight import Flight, Log
from gerono.policy import Policy
from gerono.scenario import Observation, Scenario, Simulation
from gerono.sweeps import Rate, Sweep, choice, log_uniform, normal, sweep, uniform

__all__ = [
    "DTYPES",
    "FAILSAFE",
    "Controller",
    "Flight",
    "Log",
    "Now",
    "Observation",
    "Policy",
    "Rate",
    "Scenario",
    "ScenarioError",
    "Simulation",
    "Snapshot",
    "Sweep",
    "__version__",
    "choice",
    "log_uniform",
    "normal",
    "sweep",
    "uniform",
]
