"""Sweeps have the rows of the command."""

import json
import subprocess

import controller
import pytest
from conftest import REPOSITORY, SHORT, ctrl_c

import gerono
from gerono.scenario import settings_of
from gerono.sweeps import sweep_text

VARY = {"vehicle.mass": gerono.uniform(0.18, 0.26), "controller.k1": gerono.choice(2.0, 4.0)}


def test_rows_are_those_of_the_command(fig1, command, tmp_path):
    runs = gerono.sweep(fig1, VARY, samples=20, set=SHORT, folder=tmp_path / "module")
    text = sweep_text(fig1, 20, 1, "random", VARY, {}, None, (), settings_of(SHORT), "none")
    (tmp_path / "sweep.toml").write_text(text)
    subprocess.run(
        [command, "sweep", "run", tmp_path / "sweep.toml", "--out", tmp_path / "command"], check=True, capture_output=True
    )
    ours, theirs = (gerono.Sweep(tmp_path / name).to_polars() for name in ("module", "command"))
    assert ours.equals(theirs)
    assert runs.rate().value == 1.0
    assert 0.8 < runs.rate().low < 1.0


def test_a_row_is_the_flight_of_its_values(fig1):
    runs = gerono.sweep(fig1, VARY, samples=3, set=SHORT, method="sobol")
    for row in runs.to_polars().iter_rows(named=True):
        values = {key: row[key] for key in VARY}
        assert fig1.fly(seed=row["seed"], set=SHORT | values).summary.metrics.rmse == row["rmse"]
    assert runs.rate().low is None


def test_settings_may_be_an_iterator(fig1):
    short = settings_of(SHORT)
    listed, read = (
        gerono.sweep(fig1, VARY, samples=2, set=form(short), compare={"a": None, "b": form(["controller.k2=3.0"])})
        for form in (list, iter)
    )
    assert listed.to_pandas().equals(read.to_pandas())
    # A flight of SHORT has 2 s, that of the scenario 60 s and two phases.
    assert "phase2_rmse" not in read.to_pandas()


def test_laws_fly_the_same_samples():
    laboratory = gerono.Scenario(REPOSITORY / "scenarios" / "fig3_6.toml")
    compare = {"paper": None, "indi": {"controller.law": "indi"}}
    runs = gerono.sweep(laboratory, VARY, samples=4, set=SHORT, compare=compare)
    table = runs.to_pandas()
    assert list(table["law"].unique()) == ["paper", "indi"]
    paper, indi = (table[table["law"] == law]["vehicle.mass"].tolist() for law in ("paper", "indi"))
    assert paper == indi
    assert runs.rate(law="indi").flown == 4
    with pytest.raises(KeyError, match="paper, indi"):
        runs.rate(law="pid")


def test_ctrl_c_ends_a_sweep_and_keeps_its_rows(fig1, tmp_path):
    arguments = {"samples": 300, "set": SHORT | {"duration": 20.0}, "folder": tmp_path, "jobs": 1}

    def has_rows():
        return any(rows.read_text().count("\n") > 1 for rows in tmp_path.glob("*.rows.partial"))

    with ctrl_c(after=0.0, when=has_rows):
        gerono.sweep(fig1, VARY, **arguments)
    (rows,) = tmp_path.glob("*.rows.partial")
    kept = len(rows.read_text().splitlines()) - 1
    assert 0 < kept < 300
    assert len(gerono.sweep(fig1, VARY, **arguments).to_polars()) == 300


def test_deep_criteria_are_refused(fig1):
    deep = "(" * 200_000 + "1" + ")" * 200_000
    with pytest.raises(Exception, match="at most 100 deep"):
        gerono.sweep(fig1, VARY, samples=2, set=SHORT, judge={"deep": deep})


def test_a_class_is_swept(hover):
    vary = {"vehicle.mass": gerono.uniform(0.19, 0.21)}
    runs = gerono.sweep(hover, vary, samples=4, set={"duration": 3.0}, controller=controller.Hover)
    rows = runs.to_polars()
    assert len(rows) == 4
    row = rows.row(2, named=True)
    flight = hover.fly(row["seed"], {"duration": 3.0, "vehicle.mass": row["vehicle.mass"]}, controller.Hover())
    assert flight.summary.metrics.rmse == row["rmse"]


class Stiff(controller.Hover):
    """The hover controller, which pushes a little more."""

    more = 1.05

    def step(self, now, state, reference, command, errors):
        super().step(now, state, reference, command, errors)
        command["thrust"] *= self.more


HOVER = {"vary": {"vehicle.mass": gerono.uniform(0.19, 0.21)}, "samples": 6, "set": {"duration": 2.0}}


def test_classes_and_laws_are_compared_on_the_same_samples(hover):
    alone = gerono.Scenario(hover.path, hover.text.split("[programs]")[0])
    compare = {"mine": controller.Hover, "stiff": Stiff, "paper": {}}
    runs = gerono.sweep(alone, compare=compare, **HOVER)
    rows = runs.to_pandas()
    for law, flown in {"mine": controller.Hover, "stiff": Stiff, "paper": None}.items():
        for row in rows[rows["law"] == law].to_dict("records"):
            sets = HOVER["set"] | {"vehicle.mass": row["vehicle.mass"]}
            flight = alone.fly(row["seed"], sets, flown and flown())
            assert flight.summary.metrics.rmse == row["rmse"]
    errors = [rows[rows["law"] == law]["rmse"].tolist() for law in compare]
    assert errors[0] != errors[1] != errors[2]
    pairs = {(entry.law, entry.reference, entry.pairs) for entry in runs.summary.differences if entry.name == "steady_rmse"}
    assert pairs == {("stiff", "mine", 6), ("paper", "mine", 6)}
    # No theorem is about a class.
    assert rows[rows["law"] == "mine"]["ultimate_bound"].isna().all()


def test_what_is_named_flies_or_is_refused(hover):
    for wrong, reason in [
        ({"compare": {"mine": {}, "indi": {"controller.law": "indi"}}}, "and not this law"),
        ({"set": {"controller.k1": 5.0}}, "has no effect"),
    ]:
        with pytest.raises(gerono.ScenarioError, match=reason):
            gerono.sweep(hover, controller=controller.Hover, **HOVER | wrong)
    with pytest.raises(gerono.ScenarioError, match="has no effect"):
        gerono.sweep(hover, controller=controller.Hover, **HOVER | {"vary": {"controller.k1": gerono.uniform(1.0, 2.0)}})
    with pytest.raises(ValueError, match="flies every law"):
        gerono.sweep(hover, controller=controller.Hover, compare={"stiff": Stiff}, **HOVER)


def test_arguments_without_an_effect_are_refused(hover, fig1):
    for jobs in (0, -1):
        with pytest.raises(ValueError, match=f"one core at least, not on {jobs}"):
            gerono.sweep(fig1, VARY, samples=2, set=SHORT, jobs=jobs)
    for classes in ({"controller": controller.Hover}, {"compare": {"mine": controller.Hover}}):
        with pytest.raises(ValueError, match="follow one another on one core, not on 7"):
            gerono.sweep(hover, jobs=7, **classes, **HOVER)
    assert gerono.sweep(hover, jobs=1, controller=controller.Hover, **HOVER | {"samples": 1}).rate().flown == 1
    for seeded in ({"set": SHORT | {"seed": 5}}, {"compare": {"one": {}, "two": {"seed": 5}}}):
        with pytest.raises(ValueError, match="`seed` in the settings has no effect: the argument `seed` gives"):
            gerono.sweep(fig1, VARY, samples=2, **{"set": SHORT} | seeded)


def test_a_controller_is_made_for_each_flight(hover):
    made = controller.Hover()
    for classes in ({"controller": made}, {"compare": {"mine": made}}):
        with pytest.raises(TypeError, match="pass the class or a function that makes one, not a Hover"):
            gerono.sweep(hover, **classes, **HOVER)
    with pytest.raises(TypeError, match="a class or a function that makes a controller, not 'Hover'"):
        gerono.sweep(hover, controller="Hover", **HOVER)
    with pytest.raises(TypeError, match=r"a gerono\.Controller, not a NoneType"):
        gerono.sweep(hover, controller=lambda: None, **HOVER)

    class Gained(controller.Hover):
        gain = 1.0

    def others():
        made = Gained()
        made.gain = next(gains)
        return made

    gains = iter(range(10))
    with pytest.raises(RuntimeError, match="not the same at every call"):
        gerono.sweep(hover, controller=others, **HOVER)


def test_flights_may_change_what_objects_of_a_class_share(hover):
    class Helper:
        calls = 0

        def __call__(self, thrust):
            Helper.calls += 1
            return thrust

    class Helped(controller.Hover):
        def __init__(self):
            self.helper = Helper()

        def step(self, now, state, reference, command, errors):
            super().step(now, state, reference, command, errors)
            command["thrust"] = self.helper(command["thrust"])

    def of_a_class_of_its_own():
        return type("Own", (Helped,), {})()

    for make in (Helped, of_a_class_of_its_own):
        runs = gerono.sweep(hover, controller=make, **HOVER).to_pandas()
        assert runs["rmse"].tolist() == gerono.sweep(hover, controller=controller.Hover, **HOVER).to_pandas()["rmse"].tolist()
    assert Helper.calls > 12 * 400


def test_a_rate_of_nothing_says_so(tmp_path):
    survived = {"name": "survived", "rate": None, "wilson": None, "met": 0, "flown": 0}
    summary = {"samples": 3, "laws": [{"name": "as stated", "criteria": [survived]}]}
    (tmp_path / "sweep.json").write_text(json.dumps(summary))
    assert str(gerono.Sweep(tmp_path).rate()) == "none flown"
    assert repr(gerono.Sweep(tmp_path)) == f"<Sweep {tmp_path}: 3 samples, survived: as stated 0 of 0>"


def test_a_grid_has_the_levels_and_the_rank_that_are_stated(fig1):
    vary = {"vehicle.mass": gerono.uniform(0.18, 0.24, levels=4)}
    flown = gerono.sweep(fig1, vary, method="grid", rank="max", compare={"paper": None, "soft": {"controller.k1": 3.0}}, set=SHORT)
    assert flown.to_pandas()["vehicle.mass"].unique().tolist() == [0.18, 0.2, 0.22, 0.24]
    assert flown.summary.winners[0].range == [0.18, 0.18]
    assert flown.summary.laws[0].quantiles[0].name == "max"
    assert repr(flown).endswith("4 samples, survived: paper 4 of 4, soft 4 of 4>")


def test_a_folder_belongs_to_one_class_and_one_sweep(hover, tmp_path):
    first = gerono.sweep(hover, controller=controller.Hover, folder=tmp_path, **HOVER).to_pandas()
    again = gerono.sweep(hover, controller=controller.Hover, folder=tmp_path, **HOVER).to_pandas()
    assert first.equals(again)

    class Stiffer(Stiff):
        more = 1.1

    for other in (Stiff, Stiffer, None):
        with pytest.raises(gerono.ScenarioError, match="of another sweep"):
            gerono.sweep(hover, controller=other, folder=tmp_path, **HOVER)
    with pytest.raises(gerono.ScenarioError, match="of another sweep"):
        gerono.sweep(hover, controller=controller.Hover, folder=tmp_path, **HOVER | {"samples": 7})


def test_a_flight_that_was_broken_off_leaves_no_row(hover, tmp_path):
    fails = [True]

    class Fails(controller.Hover):
        def step(self, now, *samples):
            super().step(now, *samples)
            if now.time > 1.0 and fails[0]:
                raise ZeroDivisionError("at one second")

    whole = gerono.sweep(hover, controller=controller.Hover, **HOVER).to_pandas()
    with pytest.raises(ZeroDivisionError, match="at one second"):
        gerono.sweep(hover, controller=Fails, folder=tmp_path, **HOVER)
    (rows,) = tmp_path.glob("*.rows.partial")
    assert len(rows.read_text().splitlines()) == 1

    # A file is no part of the class, whose rows are to be resumed. It has a letter for each flight that has begun.
    begun, folder = tmp_path / "begun", tmp_path / "interrupted"

    class Interrupted(controller.Hover):
        def step(self, now, *samples):
            super().step(now, *samples)
            if now.tick == 0:
                with begun.open("a") as file:
                    file.write(".")
            if now.time > 1.0 and begun.stat().st_size == 3:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        gerono.sweep(hover, controller=Interrupted, folder=folder, **HOVER)
    (rows,) = folder.glob("*.rows.partial")
    kept = len(rows.read_text().splitlines()) - 1
    assert 0 < kept < 6
    resumed = gerono.sweep(hover, controller=Interrupted, folder=folder, **HOVER).to_pandas()
    assert resumed["rmse"].tolist() == whole["rmse"].tolist()


def test_what_is_wrong_is_said(fig1):
    with pytest.raises(gerono.ScenarioError, match="masss"):
        gerono.sweep(fig1, {"vehicle.masss": gerono.uniform(0.1, 0.2)}, samples=2)
    with pytest.raises(gerono.ScenarioError):
        gerono.sweep(fig1, {"vehicle.mass": gerono.uniform(0.2, 0.1)}, samples=2)

    def broken():
        raise LookupError("no controller")

    with pytest.raises(LookupError, match="no controller"):
        gerono.sweep(fig1, HOVER["vary"], samples=2, set=SHORT, controller=broken)
