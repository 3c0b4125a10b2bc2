"""A controller in Python as a service of a running flight (docs/process_contract.md).

    if __name__ == "__main__":
        gerono.external.fly(Mine())

in the program that a scenario names under `[programs]`. It needs `pip install gerono[external]`.
"""

from __future__ import annotations

import ctypes
import json
import os
import select
import socket
import sys
import time
from typing import Any

import iceoryx2 as iox2  # type: ignore[import-untyped]
import numpy as np

from gerono._samples import dtype_of
from gerono.controller import Controller
from gerono.scenario import bridge_of

_CONTRACT = 1
_CONTROL, _MANIFEST = 3, 4  # descriptors
_MESSAGE = 1 << 17  # bytes at most
_FOREVER_NS = 1 << 62


def fly(controller: Controller) -> None:
    """Run `controller` as the controller service until the flight ends."""
    with open(_MANIFEST) as manifest:
        service = _Service(controller, json.load(manifest))
    service.run()


class _Stream:
    """A topic of the service, with its port; iceoryx2 refuses another type, size or layout."""

    def __init__(self, node: Any, entry: dict[str, Any], words: np.ndarray) -> None:
        self.entry, self.words = entry, words
        if dtype_of(entry["msg"]).itemsize != entry["size"] or words.nbytes != entry["size"]:
            sys.exit(f"the layout of {entry['topic']} differs from that of this package: use the same version of both")
        members = {"_fields_": [("words", ctypes.c_uint64 * len(words))], "type_name": staticmethod(lambda: entry["type"])}
        self.sample = type("Sample", (ctypes.Structure,), members)
        layout = iox2.AttributeKey.new("layout"), iox2.AttributeValue.new(entry["attributes"]["layout"])
        builder = node.service_builder(iox2.ServiceName.new(entry["topic"])).publish_subscribe(self.sample)
        service = builder.open_with_attributes(iox2.AttributeVerifier.new().require(*layout))
        if "buffer" in entry:
            self.port = service.subscriber_builder().buffer_size(entry["buffer"]).create()
        else:
            discard = iox2.BackpressureStrategy.DiscardData
            self.port = service.publisher_builder().backpressure_strategy(discard).create()
        self.received: dict[int, np.ndarray] = {}

    def due(self, tick: int) -> int:
        """Return the publication tick of the sample that a step at `tick` reads."""
        published = tick - int(self.entry["latency"])
        return published - (published - int(self.entry["phase"])) % int(self.entry["period"])

    def receive(self) -> bool:
        """Receive one sample, if there is one."""
        sample = self.port.receive()
        if sample:
            words = np.array(sample.payload().contents.words, np.uint64)
            self.received[int(words[0])] = words
        return bool(sample)

    def copy_newest(self, due: int) -> bool:
        """Copy the newest sample up to a tick to the controller; return whether there is one."""
        found = max((tick for tick in self.received if tick <= due), default=None)
        if found is None:
            return False
        self.received = {tick: words for tick, words in self.received.items() if tick >= found}
        self.words[:] = self.received[found]
        return True

    def publish(self, tick: int, tick_ns: int) -> None:
        """Publish the output of the controller, and ring the bells of its subscribers."""
        sequence = (tick - self.entry["phase"]) // self.entry["period"]
        self.words[:3] = tick, tick * tick_ns, sequence
        self.port.send_copy(self.sample((ctypes.c_uint64 * len(self.words)).from_buffer_copy(self.words.tobytes())))
        for bell in self.entry["bells"]:
            os.eventfd_write(bell, 1)


class _Service:
    def __init__(self, controller: Controller, manifest: dict[str, Any]) -> None:
        self.manifest = manifest
        self.control = socket.socket(fileno=_CONTROL)
        if manifest["contract"] != _CONTRACT:
            sys.exit(f"the flight has version {manifest['contract']} of the contract; this package has {_CONTRACT}")
        if self.receive_message() != "MakePorts":
            sys.exit("the first message of the flight is not MakePorts")
        self.bridge = bridge_of(controller, manifest["scenario"])
        config = iox2.config.from_file(iox2.FilePath.new(manifest["iceoryx2_configuration"]))
        self.node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
        self.inputs = [_Stream(self.node, *pair) for pair in zip(manifest["inputs"], self.bridge.input_words)]
        self.outputs = [_Stream(self.node, *pair) for pair in zip(manifest["outputs"], self.bridge.output_words)]

    def receive_message(self) -> Any:
        """Return the next message; exit if the flight has ended or closed the socket."""
        packet = self.control.recv(_MESSAGE)
        message = json.loads(packet) if packet else "Stop"
        if message == "Stop":
            sys.exit()
        return message

    def send_message(self, message: Any) -> None:
        self.control.send(json.dumps(message).encode())

    def run(self) -> None:
        """Step at every due tick until the flight ends."""
        manifest = self.manifest
        self.send_message({"Ready": {"receivers": [f"{stream.port.id.value:x}" for stream in self.inputs]}})
        start_ns = self.receive_message()["Go"]["start_ns"]
        tick, last_step = manifest["phase"], None
        while tick <= manifest["last_tick"]:
            deadline_ns = _FOREVER_NS
            if manifest["host"] == "real_time":
                tick, deadline_ns = self.await_time(tick, start_ns)
            arrived = sum(self.await_input(stream, tick, deadline_ns) << bit for bit, stream in enumerate(self.inputs))
            self.step(tick, 0 if last_step is None else tick - last_step, arrived)
            tick, last_step = tick + manifest["period"], tick
        self.send_message("Finished")
        while True:
            self.receive_message()

    def await_time(self, tick: int, start_ns: int) -> tuple[int, int]:
        """Wait for the next step on the clock, skipping missed ones; return its tick, and the deadline of its inputs, ns."""
        manifest, tick_ns = self.manifest, self.manifest["tick_ns"]
        now = min((time.monotonic_ns() - start_ns) // tick_ns, manifest["last_tick"])
        tick = max(tick, now - (now - manifest["phase"]) % manifest["period"])
        begins_ns = start_ns + tick * tick_ns
        time.sleep(max(0, begins_ns - time.monotonic_ns()) / 1e9)
        return tick, begins_ns + max(manifest["grace_ns"], manifest["period"] * tick_ns // 2)

    def await_input(self, stream: _Stream, tick: int, deadline_ns: int) -> bool:
        """Wait for the due sample; after the deadline use the newest one received, if any."""
        due = stream.due(tick)
        while due >= stream.entry["phase"] and due not in stream.received:
            left_ns = deadline_ns - time.monotonic_ns()
            if left_ns <= 0:
                break
            if not stream.receive():
                self.await_bell(left_ns / 1e9)
        return stream.copy_newest(due)

    def await_bell(self, seconds: float) -> None:
        readable = select.select([self.manifest["bell"], self.control], [], [], seconds)[0]
        if self.control in readable:
            connect = self.receive_message()["Connect"]
            for stream in self.outputs:
                stream.port.update_connections()
            for stream in self.inputs:
                stream.port.has_samples()
            self.send_message({"Connected": connect})  # to a restarted service
        elif readable:
            os.eventfd_read(self.manifest["bell"])

    def step(self, tick: int, elapsed: int, arrived: int) -> None:
        tick_ns = self.manifest["tick_ns"]
        self.bridge.now_words[0] = tick
        self.bridge.now_words.view(np.float64)[1:] = tick * tick_ns / 1e9, elapsed * tick_ns / 1e9
        for stream in self.outputs:
            stream.words[:] = 0
        self.bridge.step(arrived)
        for stream in self.outputs:
            stream.publish(tick, tick_ns)
