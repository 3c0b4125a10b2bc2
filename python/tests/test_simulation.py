"""Flights that are flown step by step."""

import copy
import pickle

import controller
import numpy as np
import pytest
from conftest import REPOSITORY

import gerono


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


@pytest.mark.parametrize("setting", [{"controller.k1": 5.0}, {"controller.law": "indi"}, ["controller.k1=5"]])
def test_settings_of_the_law_have_no_effect_on_commands_from_outside(setting):
    laboratory = gerono.Scenario(REPOSITORY / "scenarios" / "fig3_6.toml")
    with pytest.raises(gerono.ScenarioError, match="has no effect"):
        laboratory.start(set=setting)
    laboratory.start(set={"controller.rates.yaw_kp": 1.0})


def test_a_turn_that_the_vehicle_does_not_follow_is_refused(hover):
    rates = gerono.Scenario(REPOSITORY / "scenarios" / "fig3_6.toml").start()
    with pytest.raises(ValueError, match=r"`torque_body` has no effect, .* has `\[controller\.rates\]`: command `rates_body`"):
        rates.step(1.9, torque_body=(1.0, 2.0, 3.0))
    rates.step(1.9, rates_body=(1.0, 2.0, 3.0))
    torques = hover.start()
    with pytest.raises(ValueError, match=r"`rates_body` has no effect, .* has no `\[controller\.rates\]`"):
        torques.step(1.9, rates_body=(1.0, 2.0, 3.0))
    assert torques.time == 0.0
    torques.step(1.9, (0.0, 0.0, 1e-3))
    assert torques["control/command"]["torque_body"].tolist() == [0.0, 0.0, 1e-3]


def test_no_step_comes_after_the_end(hover):
    simulation = hover.start(set={"duration": 0.5})
    before_last = None
    while not simulation.done:
        before_last = simulation.save()
        simulation.step(1.9)
    at_end = simulation.save()
    for _ in range(2):
        with pytest.raises(RuntimeError, match="at its end: `restore` a snapshot, or `start`"):
            simulation.step(1.9)
    simulation.restore(before_last)
    simulation.step(1.9)
    assert simulation.done
    simulation.restore(at_end)
    assert simulation.done


@pytest.mark.parametrize("make", [pickle.dumps, copy.copy, copy.deepcopy])
def test_what_cannot_be_pickled_says_what_to_do(hover, make):
    simulation = hover.start()
    with pytest.raises(TypeError, match="`start` another one .* and `restore` a snapshot"):
        make(simulation)
    with pytest.raises(TypeError, match="may `restore` it"):
        make(simulation.save())


def test_a_seed_is_given_once(fig1):
    for use in (fig1.fly, fig1.start, fig1.values):
        with pytest.raises(ValueError, match="`seed` in the settings has no effect: the argument `seed`"):
            use(seed=3, set={"seed": 5})
        with pytest.raises(ValueError, match="remove one of them"):
            use(seed=3, set=["seed = 5"])
    assert fig1.values(set={"seed": 5})["seed"] == fig1.values(seed=5)["seed"] == 5
