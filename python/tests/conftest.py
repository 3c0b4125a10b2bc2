"""Scenarios and controllers that the tests share."""

import sys
from pathlib import Path

import pytest

import gerono

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "examples" / "python_controller"))

# Fig. 1 for two seconds, without its step of mass.
SHORT = {"duration": 2.0, "vehicle.change": []}


@pytest.fixture(scope="session")
def fig1():
    return gerono.Scenario(REPOSITORY / "scenarios" / "fig1.toml")


@pytest.fixture(scope="session")
def hover():
    return gerono.Scenario(REPOSITORY / "examples" / "python_controller" / "hover.toml")


@pytest.fixture(scope="session")
def command():
    """The command of the wheel: beside the interpreter."""
    program = Path(sys.executable).parent / "gerono"
    assert program.exists(), "the wheel brings the command"
    return program
