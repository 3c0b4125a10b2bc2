"""Builds the wheel: the module by maturin, and beside it the command, which Cargo builds first.

A wheel of maturin has a module or a program. The command goes in as a script of the wheel, so that `pip install`
puts the real binary on the path: services of a flight are started from it.
"""

import json
import shutil
import subprocess
from pathlib import Path

import maturin
from maturin import get_requires_for_build_editable, get_requires_for_build_wheel

__all__ = [
    "build_editable",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_wheel",
]

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS = ROOT / "python" / "gerono.data" / "scripts"


def build_command():
    """Build the command and put it where maturin takes it from."""
    build = ["cargo", "build", "--release", "--locked", "--package", "orchestrator", "--bin", "gerono"]
    told = subprocess.run([*build, "--message-format", "json"], cwd=ROOT, stdout=subprocess.PIPE, check=True)
    messages = map(json.loads, told.stdout.splitlines())
    [program] = [message["executable"] for message in messages if message.get("executable")]
    SCRIPTS.mkdir(parents=True, exist_ok=True)
    shutil.copy2(program, SCRIPTS / "gerono")


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    """Build the wheel, as PEP 517 says."""
    build_command()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """Build what `pip install --editable` takes, as PEP 660 says."""
    build_command()
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)
