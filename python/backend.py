"""Builds the wheel: the module by maturin, and the command, which Cargo builds first.

Maturin packs either a module or a program. The command is therefore added as a script of the wheel, so that `pip
install` puts the binary itself on the path: services of a flight are started from it.
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
    """Build the command and copy it into the folder from which maturin packs scripts."""
    build = ["cargo", "build", "--release", "--locked", "--package", "orchestrator", "--bin", "gerono"]
    built = subprocess.run([*build, "--message-format", "json"], cwd=ROOT, stdout=subprocess.PIPE, check=True)
    messages = map(json.loads, built.stdout.splitlines())
    [program] = [message["executable"] for message in messages if message.get("executable")]
    SCRIPTS.mkdir(parents=True, exist_ok=True)
    shutil.copy2(program, SCRIPTS / "gerono")


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    """Build the wheel (PEP 517)."""
    build_command()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """Build the wheel of `pip install --editable` (PEP 660)."""
    build_command()
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)
