"""Controllers in Python: their state is saved and restored, and they fly as a service does."""

import subprocess
import sys

import controller
import numpy as np
import pytest
from conftest import REPOSITORY, SHORT

import gerono
from gerono.scenario import settings_of


class Counting(controller.Hover):
    """The hover controller, with a slow integral and a number of steps as its state."""

    steps = 0
    integral = np.zeros(3)

    def step(self, now, state, reference, command, errors):
        super().step(now, state, reference, command, errors)
        self.steps += 1
        self.integral += errors["z1"] * now.elapsed
        command["thrust"] += self.integral[2] * 0.1


class Locking(controller.Hover):
    """A controller that locks the memory of its input."""

    def step(self, now, state, reference, command, errors):
        super().step(now, state, reference, command, errors)
        memory = state
        while memory.base is not None:
            memory = memory.base
        memory.flags.writeable = False


class Misspelt(controller.Hover):
    """A controller that names a field that does not exist."""

    def step(self, now, state, reference, command, errors):
        command["thurst"] = 1.0


def test_a_field_that_does_not_exist_is_named_with_those_that_do(hover):
    with pytest.raises(ValueError, match=r"no sample has a field `thurst`: `state` has .*`command` has .*\bthrust\b"):
        hover.fly(set={"duration": 0.5}, controller=Misspelt())


def test_locked_memory_is_an_error(hover):
    with pytest.raises(Exception, match="writeable"):
        hover.fly(set={"duration": 0.5}, controller=Locking())


def test_a_class_and_a_service_fly_the_same_bytes(hover, command, tmp_path):
    program = f'programs.controller=["{sys.executable}", "controller.py"]'
    subprocess.run([command, "run", hover.path, "--set", program, "--quiet", "--out", tmp_path], check=True)
    digest = subprocess.run([command, "digest", tmp_path], check=True, capture_output=True, text=True)
    flight = hover.fly(controller=controller.Hover())
    assert flight.digest == digest.stdout.strip()
    assert flight.summary.phases[0].ultimate < 0.001


def test_planned_faults_act_on_a_class(hover, command, tmp_path):
    """An outage is exact, and the rest of the log is computed again from what was recorded."""
    alone = gerono.Scenario(hover.path, hover.text.split("[programs]")[0])
    plain, again = (alone.fly(controller=Counting()) for _ in range(2))
    assert plain.digest == again.digest
    outage = {"fault": [{"service": "controller", "kind": "off", "at": 3.0, "for": 0.2}]}
    laws = [Counting(), Counting()]
    first, second = (alone.fly(controller=law, set=outage) for law in laws)
    assert first.digest == second.digest != plain.digest
    assert first.summary.outcome == "completed"
    # A step of 5 ms that is off is not taken, and the state goes on after it.
    assert 2001 - 41 <= laws[0].steps <= 2001 - 39
    first.save(tmp_path)
    replay = subprocess.run([command, "replay", tmp_path, "--quiet"], capture_output=True, text=True)
    assert "controller cannot be computed again" in replay.stdout
    assert replay.returncode == 0, replay.stdout + replay.stderr


def test_a_cold_start_begins_with_the_state_of_the_class():
    """The first step of this controller is not at tick 0, and its memory is not that of Gerono's law."""
    seen = []

    class Known(gerono.Controller):
        before, mass, sevens = np.full(3, 7.0), 0.19, 7

        def step(self, now, state, reference, command, errors):
            seen.append((now.tick, self.mass, self.sevens, *self.before))
            self.sevens += 1
            command["mode"] = gerono.FAILSAFE

    laboratory = gerono.Scenario(REPOSITORY / "scenarios" / "fig3_6.toml")
    for state in ("warm", "cold"):
        seen.clear()
        outage = {"service": "controller", "kind": "off", "at": 0.3, "for": 0.1, "state": state}
        short = {"duration": 0.6, "vehicle.change": [], "fault": [outage]}
        laboratory.fly(set=short, controller=Known())
        first, *rest = dict(zip((step[0] for step in seen), seen)).values()
        assert first[0] > 0
        assert first[1:] == (0.19, 7, 7.0, 7.0, 7.0)
        assert all(step[1] == 0.19 for step in rest)
        begun_anew = [step[2] for step in rest if step[2] == 7]
        assert len(begun_anew) == (state == "cold")


forgotten = [0.0]


class Forgets(controller.Hover):
    """A controller whose integral is a variable of the module."""

    def step(self, now, state, reference, command, errors):
        super().step(now, state, reference, command, errors)
        forgotten[0] += 1e-3
        command["thrust"] += forgotten[0]


class Remembers(Forgets):
    """The same, which saves the variable."""

    def save(self):
        return [*super().save(), forgotten[0]]

    def restore(self, numbers):
        super().restore(numbers[:-1])
        forgotten[0] = numbers[-1]


class ForgetsOfItself(controller.Hover):
    """A controller whose memory is a constant by its type."""

    last = (0.0,)

    def step(self, now, state, reference, command, errors):
        super().step(now, state, reference, command, errors)
        self.last = (self.last[0] + 1e-3,)
        command["thrust"] += self.last[0]


def test_forgotten_state_is_found_in_every_flight(hover):
    for kind in (Forgets, ForgetsOfItself):
        forgotten[0] = 0.0
        with pytest.raises(RuntimeError, match=f"{kind.__name__} forgets a part of its state"):
            hover.fly(set={"duration": 0.5}, controller=kind())
    flights = []
    for _ in range(2):
        forgotten[0] = 0.0
        flights.append(hover.fly(set={"duration": 0.5}, controller=Remembers()).digest)
    assert flights[0] == flights[1]


def test_settings_of_another_law_are_refused(hover):
    # The example names its program, which is refused beside another law already.
    for key, value, reason in [
        ("controller.law", "indi", "and not this law"),
        ("controller.k1", 5.0, "has no effect"),
    ]:
        with pytest.raises(gerono.ScenarioError, match=reason):
            hover.fly(set={key: value, "duration": 0.1}, controller=controller.Hover())


def test_classes_are_not_shared_by_flights(hover):
    one = Counting()
    hover.fly(controller=one, set={"duration": 1.0})
    assert one.steps == 201
    assert np.any(one.integral)
    assert Counting.steps == 0
    assert not np.any(Counting.integral)


def test_state_goes_there_and_back():
    from gerono.controller import Bridge

    class Many(gerono.Controller):
        flag, whole, part = True, 3, 0.1
        matrix = np.arange(6.0).reshape(2, 3)
        counts = np.array([1, 2], np.int64)
        name, pair = "text", (1, 2)

    first, second = Many(), Many()
    bridges = Bridge(first), Bridge(second)
    first.flag, first.whole, first.part = False, 2**52 + 1, np.pi
    first.matrix[1] = 7.0
    first.counts[0] = -5
    bridges[1].unpack(bridges[0].pack())
    assert (second.flag, second.whole, second.part) == (False, 2**52 + 1, np.pi)
    assert second.flag is False
    assert np.array_equal(first.matrix, second.matrix)
    assert np.array_equal(first.counts, second.counts)
    assert bridges[0].state_size == len(bridges[0].pack())


def test_state_that_cannot_be_saved_is_refused(hover):
    class Remembers(controller.Hover):
        def __init__(self):
            self.past = []

    with pytest.raises(TypeError, match=r"Remembers\.past is a list"):
        hover.fly(controller=Remembers())
    with pytest.raises(TypeError, match=r"gerono\.Controller"):
        hover.fly(controller=object())
    with pytest.raises(TypeError, match=r"pass Hover\(\), not the class"):
        hover.fly(controller=controller.Hover)


@pytest.mark.parametrize(
    "value", [2**53 + 1, -(2**60), np.int64(2**60), np.array([0, -(2**53) - 1]), np.array([2**64 - 1], np.uint64)]
)
def test_whole_numbers_that_a_state_would_round_are_refused(hover, value):
    class Counts(controller.Hover):
        seed = value

    with pytest.raises(ValueError, match=r"Counts\.seed is the integer -?\d{16,}, .* exact up to 2\*\*53"):
        hover.fly(controller=Counts(), set={"duration": 0.1})
    Counts.seed = 2**53
    assert hover.fly(controller=Counts(), set={"duration": 0.1}).summary.outcome == "completed"


@pytest.mark.parametrize("value", [np.longdouble(0.1), np.zeros(2, np.longdouble), np.complex128(1j), np.timedelta64(3, "s")])
def test_numbers_that_a_state_would_cut_are_refused(hover, value):
    class Wide(controller.Hover):
        wide = value

    with pytest.raises(TypeError, match=r"Wide\.wide is a .*, which a flight cannot save"):
        hover.fly(controller=Wide())


class SavesItself(Counting):
    """The same, with a state of its own."""

    def save(self):
        return [*self.integral, self.steps]

    def restore(self, numbers):
        self.integral[:], self.steps = numbers[:3], numbers[3]


@pytest.mark.parametrize("kind", [Counting, SavesItself])
def test_an_object_begins_each_flight_as_its_first(hover, kind):
    short = {"duration": 1.0}
    fresh, other = kind(), kind()
    other.integral = np.array((0.0, 0.0, 0.5))
    digests = [hover.fly(controller=law, set=short).digest for law in (fresh, other)]
    law = kind()
    for _ in range(3):
        assert hover.fly(controller=law, set=short).digest == digests[0]
        # It keeps the state with which a flight has ended.
        assert law.steps == 201
        assert np.any(law.integral)
    # What is set between two flights counts, for all that come.
    law.integral[:] = (0.0, 0.0, 0.5)
    for _ in range(2):
        assert hover.fly(controller=law, set=short).digest == digests[1] != digests[0]


def test_an_object_begins_as_its_first_flight_after_one_that_was_broken_off(hover):
    class Fails(Counting):
        fails_at = 0.5

        def step(self, now, *samples):
            super().step(now, *samples)
            if now.time >= self.fails_at:
                raise ZeroDivisionError

    law = Fails()
    with pytest.raises(ZeroDivisionError):
        hover.fly(controller=law)
    law.fails_at = 100.0
    assert hover.fly(controller=law).digest == hover.fly(controller=Counting()).digest


class Changes(controller.Hover):
    """A controller that changes a constant without an effect on its commands."""

    mode, table, pair = "climb", {"gain": [1.0]}, (np.zeros(2), "text")
    new: tuple

    def change(self):
        pass

    def step(self, now, *samples):
        super().step(now, *samples)
        if now.time >= 0.4:
            self.change()


CHANGES = {
    "mode": lambda law: setattr(law, "mode", "sink"),
    "table": lambda law: law.table["gain"].append(2.0),
    "pair": lambda law: law.pair[0].__setitem__(0, 1.0),
    "new": lambda law: setattr(law, "new", ()),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_flight_that_changes_a_constant_is_refused(hover, name):
    def changing(**members):
        own = {"table": {"gain": [1.0]}, "pair": (np.zeros(2), "text"), "change": CHANGES[name]}
        return type("Changing", (Changes,), own | members)()

    for short in (0.5, 4.0):  # before the first trial with the change, and after it
        law = changing()
        with pytest.raises(RuntimeError, match=rf"a flight has changed Changing\.{name}, "):
            hover.fly(controller=law, set={"duration": short})
        with pytest.raises(RuntimeError, match="has changed a constant, .* make a new object"):
            hover.fly(controller=law, set={"duration": short})
    saves_itself = changing(save=lambda law: [], restore=lambda law, numbers: None)
    assert hover.fly(controller=saves_itself, set={"duration": 0.5}).summary.outcome == "completed"


def test_constants_may_be_set_between_flights(hover):
    law = Changes()
    for mode in ("climb", "sink"):
        law.mode = mode
        assert hover.fly(controller=law, set={"duration": 0.5}).summary.outcome == "completed"


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
def test_an_error_of_a_step_is_not_masked_by_its_state(hover, error):
    class Breaks(Counting):
        def step(self, now, *samples):
            self.steps = 2**60
            raise error("the first")

    law = Breaks()
    with pytest.raises(error, match="the first"):
        hover.fly(controller=law)
    law.steps = 0
    with pytest.raises(RuntimeError, match="make a new object"):
        hover.fly(controller=law)


def test_an_error_of_a_step_is_raised_by_the_flight(hover):
    class Fails(controller.Hover):
        def step(self, now, *samples):
            if now.time >= 1.0:
                raise ZeroDivisionError("at one second")

    with pytest.raises(ZeroDivisionError, match="at one second"):
        hover.fly(controller=Fails())


def test_a_class_that_commands_nothing_loses_the_vehicle(hover):
    class Idle(controller.Hover):
        def step(self, now, state, reference, command, errors):
            pass

    flight = hover.fly(controller=Idle())
    assert flight.summary.outcome == "lost"
    assert flight.summary.lost.time < 3.0
    assert "m from the path" in flight.summary.reason


def test_numbers_that_are_not_finite_end_the_flight(hover):
    class NotFinite(controller.Hover):
        def step(self, now, state, reference, command, errors):
            super().step(now, state, reference, command, errors)
            if now.time >= 1.0:
                command["thrust"] = np.nan

    flight = hover.fly(controller=NotFinite())
    assert flight.summary.outcome == "failed"
    assert "control/command" in flight.summary.reason
    swept = gerono.sweep(hover, {"vehicle.mass": gerono.uniform(0.19, 0.21)}, samples=1, controller=NotFinite)
    assert swept.to_pandas()["outcome"].tolist() == ["failed"]


def test_telemetry_has_the_names_of_the_scenario(hover):
    class Tells(controller.Hover):
        def step(self, now, *samples):
            super().step(now, *samples)
            self.telemetry[:2] = now.time, now.tick

    flight = hover.fly(controller=Tells(), set={"controller.telemetry": ["clock", "ticks"]})
    table = flight.to_pandas("control/telemetry")
    assert np.allclose(table["clock"], table["time"])
    assert np.array_equal(table["ticks"], table["tick"])


@pytest.mark.parametrize("names", [[], ["one", "two", "three"]])
def test_telemetry_without_a_name_is_refused(hover, names):
    class Tells(controller.Hover):
        def step(self, now, *samples):
            super().step(now, *samples)
            self.telemetry[: len(names)] = 1.0
            self.telemetry[3] = 2.0

    with pytest.raises(IndexError, match=rf"room for {len(names)} numbers, as many as `controller\.telemetry`"):
        hover.fly(controller=Tells(), set={"controller.telemetry": names})


WRITTEN = {
    "two": ("[:] = 1, 2", [1.0, 2.0]),
    "one": ("[0:1] = 7", [7.0, 0.0]),
    "last": ("[-1] = 7", [0.0, 7.0]),
    "empty": ("[2:] = 7", [0.0, 0.0]),
    "chosen": ("[[True, False]] = 7", [7.0, 0.0]),
    "sum": ("[0:2] += 7", [7.0, 7.0]),
    "view": ("[1:][0] = 7", [0.0, 7.0]),
    "clipped": ("[0:5] = 7", "room for 2 numbers"),
    "clipped before": ("[-5:] = 7", "room for 2 numbers"),
    "clipped sum": ("[0:5] += 7", "room for 2 numbers"),
    "clipped view": ("[1:][0:2] = 7", "room for 2 numbers"),
    "numpy number": ("[: self.telemetry.shape[0] + self.telemetry.argmax() + 1] = 7", "room for 2 numbers"),
    "view of more": ("[1:][1] = 7", "room for 2 numbers"),
    "list": ("[[0, 2]] = 7", "room for 2 numbers"),
    "more": ("[:] = 1, 2, 3", "room for 2 numbers"),
    "shape": ("[0] = 1, 2", "sequence|shape"),
    "text": ("[0] = 'abc'", "^could not convert string to float"),
    "name": ("['clock'] = 1", "^only integers"),
    "attribute": (" = 1, 2", "replaces its `adaptation` or `telemetry`"),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_telemetry_is_recorded_as_written_or_refused_for_the_true_reason(hover, name):
    statement, expected = WRITTEN[name]

    class Tells(controller.Hover):
        def step(self, now, *samples):
            super().step(now, *samples)
            exec(f"self.telemetry{statement}", {"self": self})  # noqa: S102

    setting = {"duration": 0.01, "controller.telemetry": ["clock", "ticks"]}
    if isinstance(expected, str):
        with pytest.raises((ValueError, IndexError), match=expected):
            hover.fly(controller=Tells(), set=setting)
    else:
        table = hover.fly(controller=Tells(), set=setting).to_pandas("control/telemetry")
        assert table[["clock", "ticks"]].iloc[0].tolist() == expected


def test_modes_that_do_not_exist_are_refused(hover):
    class Commands(controller.Hover):
        def step(self, now, state, reference, command, errors):
            command["mode"] = 7

    with pytest.raises(ValueError, match=r"Commands commands mode 7, .* 0 \(torque\), 1 \(rates\), 2 \(failsafe\)"):
        hover.fly(controller=Commands())


@pytest.mark.parametrize("mode", [0, 1, gerono.FAILSAFE])
def test_what_the_vehicle_does_not_take_is_refused(hover, mode):
    class Commands(gerono.Controller):
        def step(self, now, state, reference, command, errors):
            command["mode"], command["thrust"] = mode, 2.0

    short = {"duration": 0.1, "vehicle.change": []}
    laboratory = gerono.Scenario(REPOSITORY / "scenarios" / "fig3_6.toml")
    for scenario, taken, wrong in [(hover, 0, "body rates"), (laboratory, 1, "torques")]:
        if mode in (taken, gerono.FAILSAFE):
            assert set(scenario.fly(controller=Commands(), set=short)["control/command"]["mode"]) == {mode}
        else:
            with pytest.raises(ValueError, match=rf"Commands commands {wrong} \(mode {mode}\), .* its vehicle takes "):
                scenario.fly(controller=Commands(), set=short)


@pytest.mark.parametrize(("name", "unread", "read"), [("fig1", "rates_body", "torque_body"), ("fig3_6", "torque_body", "rates_body")])
def test_numbers_that_the_vehicle_does_not_take_are_refused(name, unread, read):
    class Commands(gerono.Controller):
        def step(self, now, state, reference, command, errors):
            command["thrust"], command[unread] = 2.0, [0.0, 0.1, 0.0]

    with pytest.raises(ValueError, match=f"Commands writes `{unread}`, .* its vehicle takes `{read}`"):
        scenario = gerono.Scenario(REPOSITORY / "scenarios" / f"{name}.toml")
        scenario.fly(controller=Commands(), set={"duration": 0.1, "vehicle.change": []})


class TellsCount(gerono.Controller):
    count = 0.0

    def step(self, now, state, reference, command, errors):
        self.count += 1.0
        command["thrust"] = 2.0
        self.telemetry[0] = self.count


NAMED = [
    {"controller.telemetry": ["count"]},
    ["controller.telemetry=['count']"],
    {"controller": {"telemetry": ["count"]}},
    {'controller."telemetry"': ["count"]},
]


@pytest.mark.parametrize("named", NAMED)
def test_numbers_of_a_class_are_recorded_under_names_that_a_flight_gives(fig1, named):
    setting = settings_of(SHORT | {"duration": 0.01}) + settings_of(named)
    flight = fig1.fly(controller=TellsCount(), set=iter(setting))
    assert flight.to_pandas("control/telemetry")["count"].tolist() == [float(step) for step in range(1, 12)]


@pytest.mark.parametrize("named", NAMED)
@pytest.mark.parametrize(
    "flies",
    [
        {"controller": TellsCount},
        {"controller": TellsCount, "compare": {"one": {}, "two": {"controller.telemetry": ["other"]}}},
        {"compare": {"one": TellsCount, "two": TellsCount}},
    ],
)
def test_numbers_of_a_class_have_names_in_a_sweep(fig1, named, flies):
    setting = settings_of(SHORT | {"duration": 0.01}) + settings_of(named)
    runs = gerono.sweep(fig1, {"vehicle.mass": gerono.uniform(0.19, 0.21)}, samples=1, set=setting, **flies)
    assert runs.rate().flown == 1
