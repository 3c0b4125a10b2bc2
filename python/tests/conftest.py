"""Scenarios and controllers that the tests share."""

import os
import signal
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

import gerono

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "examples" / "python_controller"))

# Fig. 1 for two seconds, without its step of mass.
SHORT = {"duration": 2.0, "vehicle.change": []}


@contextmanager
def ctrl_c(after, when=lambda: True):
    """The work inside is interrupted after so many seconds, and when something holds, and ends at once: KeyboardInterrupt."""
    sent = []

    def send():
        while not when():
            time.sleep(0.01)
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    # A shell that starts something in the background lets it ignore the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(after, send)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            yield
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)
    # A tenth of a second, and what a loaded machine adds.
    assert time.monotonic() - sent[0] < 3.0


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
