"""Flights that are flown step by step."""

import controller
import numpy as np
import pytest


def fly(simulation, law, until=np.inf):
    """Fly with a law outside the flight; return the positions."""
    positions = []
    while not simulation.done and simulation.time < until:
        command, errors = {}, {}
        seen = simulation.observe()
        law.step(None, seen.state, seen.reference, command, errors)
        simulation.step(command["thrust"], command["torque_body"])
        positions.append(simulation["vehicle/truth"]["position_world"].copy())
    return np.array(positions)


def test_commands_act_as_those_of_a_controller_within(hover):
    flown = hover.fly(controller=controller.Hover())["vehicle/truth"]["position_world"]
    with hover.start() as simulation:
        positions = fly(simulation, controller.Hover())
    assert np.array_equal(positions[-1], flown[-1])


def test_a_saved_flight_goes_on_to_the_bit(hover):
    simulation = hover.start()
    fly(simulation, controller.Hover(), until=3.0)
    snapshot = simulation.save()
    first = fly(simulation, controller.Hover(), until=5.0)
    simulation.restore(snapshot)
    assert simulation.time == pytest.approx(3.0)
    for _ in range(50):
        simulation.step(0.0)  # falls
    simulation.restore(snapshot)
    assert np.array_equal(fly(simulation, controller.Hover(), until=5.0), first)


def test_a_vehicle_that_falls_is_lost(hover):
    simulation = hover.start(set={"duration": 10.0})
    while not simulation.done and not simulation.lost:
        simulation.step(0.0)
    assert "m from the path" in simulation.lost
    assert simulation.time < 3.0


def test_a_snapshot_is_of_one_flight(hover, fig1):
    """Another scenario, other settings or another seed make another flight."""
    snapshot = hover.start().save()
    hover.start().restore(snapshot)
    for other in (fig1.start(), hover.start(seed=99), hover.start(set={"vehicle.mass": 0.21})):
        with pytest.raises(ValueError, match="of a flight of another scenario"):
            other.restore(snapshot)


def test_a_flight_that_has_failed_goes_on_from_a_snapshot_only(hover):
    simulation = hover.start()
    fly(simulation, controller.Hover(), until=0.5)
    snapshot = simulation.save()
    for wrong in (np.nan, np.inf):
        with pytest.raises(RuntimeError, match="not finite"):
            simulation.step(wrong)
        for use in (lambda: simulation.step(2.0), simulation.save):
            with pytest.raises(RuntimeError, match="a step has failed"):
                use()
        simulation.restore(snapshot)
        simulation.step(2.0)
        assert simulation.time == pytest.approx(0.505)
        simulation.restore(snapshot)
