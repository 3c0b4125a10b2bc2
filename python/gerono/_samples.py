"""Samples as structured arrays: message definitions as numpy types."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from gerono import _gerono

_MEMBER = re.compile(r"^([\w/]+)(?:\[(\d+)\])? (\w+)$", re.MULTILINE)
_KINDS = {"float64": "<f8", "uint64": "<u8", "uint32": "<u4", "uint16": "<u2", "uint8": "u1", "bool": "?"}


def dtype_of(definition: str) -> np.dtype[Any]:
    """Return the type of a topic's samples.

    Members have the names and units of docs/topics.md, the header's first. Rotation matrices have shape (3, 3), texts are
    bytes without trailing zeros.
    """
    names: list[str] = []
    formats: list[np.dtype[Any]] = []
    offsets: list[int] = []
    end = 0
    # The definition of Header follows the line of `=`; lines with a `=` are constants.
    for kind, length, name in _MEMBER.findall(definition.split("=" * 80)[0]):
        for own_name, own_format in _members(kind, int(length or 0), name):
            if not own_name.startswith("pad"):
                names.append(own_name)
                formats.append(own_format)
                offsets.append(end)
            end += own_format.itemsize
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": end})


def _members(kind: str, length: int, name: str) -> list[tuple[str, np.dtype[Any]]]:
    if kind == "gerono_msgs/Header":
        return [(member, np.dtype("<u8")) for member in ("tick", "stamp_ns", "seq")]
    if kind == "uint8" and name == "text":
        return [(name, np.dtype(f"S{length}"))]
    if name == "world_from_body":
        return [(name, np.dtype((_KINDS[kind], (3, 3))))]
    return [(name, np.dtype((_KINDS[kind], (length,))) if length else np.dtype(_KINDS[kind]))]


_DEFINITIONS = dict(_gerono.definitions())
DTYPES = {topic: dtype_of(definition) for topic, definition in _DEFINITIONS.items()}
#: Modes of `control/command`, and their names.
MODES = {int(mode): name for name, mode in re.findall(r"^uint32 MODE_(\w+)=(\d+)$", _DEFINITIONS["control/command"], re.MULTILINE)}
#: Phases of `path/reference` by their names.
PHASES = {name: int(phase) for name, phase in re.findall(r"^uint8 PHASE_(\w+)=(\d+)$", _DEFINITIONS["path/reference"], re.MULTILINE)}


def samples_of(topic: str, words: np.ndarray) -> np.ndarray:
    """View words as samples of a topic."""
    return words.view(DTYPES[topic])


def columns(samples: np.ndarray, telemetry: list[str] | None = None) -> dict[str, np.ndarray]:
    """Return samples as columns of numbers: `z1` becomes `z1.0`, `z1.1`, `z1.2`, matrices row by row.

    The first column is `time`, s; elements are named as by `gerono export --csv`, in faults and in sweeps. Telemetry has
    only the numbers that the scenario names.
    """
    found = {"time": samples["stamp_ns"] / 1e9}
    for name in samples.dtype.names or ():
        values = samples[name]
        if telemetry is not None and name == "values":
            found |= {own: values[:, index] for index, own in enumerate(telemetry)}
        elif values.ndim == 1:
            found[name] = values
        else:
            elements = values.reshape(len(values), math.prod(values.shape[1:]))
            found |= {f"{name}.{index}": elements[:, index] for index in range(elements.shape[1])}
    return found
