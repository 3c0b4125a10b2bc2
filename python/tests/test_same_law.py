"""An own law in Python sends the frames of the built-in one, to the bit."""

import geometric_pid
import pytest
from conftest import REPOSITORY

import gerono
import gerono.math


@pytest.fixture
def scenarios(tmp_path):
    text = (REPOSITORY / "tests" / "plugins" / "geometric_pid.toml").read_text()
    (tmp_path / "built_in.toml").write_text(text)
    (tmp_path / "own.toml").write_text(text.replace('law = "geometric_pid"\n', ""))
    return gerono.Scenario(tmp_path / "built_in.toml"), gerono.Scenario(tmp_path / "own.toml")


def test_the_same_mathematics_are_the_same_frames(scenarios):
    built_in, own = scenarios
    topics = ["rc/frame", "vehicle/truth", "control/command"]
    expected = built_in.fly(topics=topics)
    found = own.fly(controller=geometric_pid.GeometricPid(), topics=topics)
    assert len(found["rc/frame"]) == 10001
    for topic in topics:
        assert found[topic].tobytes() == expected[topic].tobytes(), topic


def test_functions_are_those_of_mathematics():
    assert gerono.math.atan2(1.0, -1.0) == pytest.approx(2.356194490192345, abs=1e-15)
    assert gerono.math.pow(2.0, 0.5) == pytest.approx(2.0**0.5, abs=1e-15)
    assert gerono.math.log1p(1e-9) == pytest.approx(1e-9, rel=1e-9)
    with pytest.raises(TypeError):
        gerono.math.sin("1")
