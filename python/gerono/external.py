"""A controller in Python as a service of a running flight: docs/process_contract.md says what is between them.

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
    """Fly `controller` in place of Gerono's until the flight is at its end."""
    with open(_MANIFEST) as manifest:
        service = _Service(controller, json.load(manifest))
    service.run()


class _Stream:
    """A topic of the service, with its port; iceoryx2 refuses another type, size or layout."""

    def __init__(self, node: Any, about: dict[str, Any], words: np.ndarray) -> None:
        self.about, self.words = about, words
        if dtype_of(about["msg"]).itemsize != about["size"] or words.nbytes != about["size"]:
            sys.exit(f"{about['topic']} has another layout than this package: use the same version of both")
        members = {"_fields_": [("words", ctypes.c_uint64 * len(words))], "type_name": staticmethod(lambda: about["type"])}
        self.sample = type("Sample", (ctypes.Structure,), members)
        layout = iox2.AttributeKey.new("layout"), iox2.AttributeValue.new(about["attributes"]["layout"])
        builder = node.service_builder(iox2.ServiceName.new(about["topic"])).publish_subscribe(self.sample)
        service = builder.open_with_attributes(iox2.AttributeVerifier.new().require(*layout))
        if "buffer" in about:
            self.port = service.subscriber_builder().buffer_size(about["buffer"]).create()
        else:
            discard = iox2.BackpressureStrategy.DiscardData
            self.port = service.publisher_builder().backpressure_strategy(discard).create()
        self.seen: dict[int, np.ndarray] = {}

    def due(self, tick: int) -> int:
        """Return the tick at which the sample was published that is to be read at a tick."""
        published = tick - int(self.about["latency"])
        return published - (published - int(self.about["phase"])) % int(self.about["period"])

    def take(self) -> bool:
        """Receive one sample, if there is one."""
        received = self.port.receive()
        if received:
            words = np.array(received.payload().contents.words, np.uint64)
            self.seen[int(words[0])] = words
        return bool(received)

    def keep_newest(self, due: int) -> bool:
        """Copy the newest sample up to a tick to the controller; return whether there is one."""
        found = max((tick for tick in self.seen if tick <= due), default=None)
        if found is None:
            return False
        self.seen = {tick: words for tick, words in self.seen.items() if tick >= found}
        self.words[:] = self.seen[found]
        return True

    def publish(self, tick: int, tick_ns: int) -> None:
        """Publish what the controller has written, and ring the bells of those who wait for it."""
        sequence = (tick - self.about["phase"]) // self.about["period"]
        self.words[:3] = tick, tick * tick_ns, sequence
        self.port.send_copy(self.sample((ctypes.c_uint64 * len(self.words)).from_buffer_copy(self.words.tobytes())))
        for bell in self.about["bells"]:
            os.eventfd_write(bell, 1)


class _Service:
    def __init__(self, controller: Controller, about: dict[str, Any]) -> None:
        self.about = about
        self.line = socket.socket(fileno=_CONTROL)
        if about["contract"] != _CONTRACT:
            sys.exit(f"the flight has version {about['contract']} of the contract; this package has {_CONTRACT}")
        if self.hear() != "MakePorts":
            sys.exit("the flight has not asked for ports")
        self.bridge = bridge_of(controller, about["scenario"])
        config = iox2.config.from_file(iox2.FilePath.new(about["iceoryx2_configuration"]))
        self.node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
        self.inputs = [_Stream(self.node, *one) for one in zip(about["inputs"], self.bridge.input_words)]
        self.outputs = [_Stream(self.node, *one) for one in zip(about["outputs"], self.bridge.output_words)]

    def hear(self) -> Any:
        """Return the next message; the end of the line is that of the flight, and of this process."""
        packet = self.line.recv(_MESSAGE)
        message = json.loads(packet) if packet else "Stop"
        if message == "Stop":
            sys.exit()
        return message

    def say(self, message: Any) -> None:
        self.line.send(json.dumps(message).encode())

    def run(self) -> None:
        """Step at every tick that is due, until the flight ends."""
        about = self.about
        self.say({"Ready": {"receivers": [f"{stream.port.id.value:x}" for stream in self.inputs]}})
        start_ns = self.hear()["Go"]["start_ns"]
        tick, last_step = about["phase"], None
        while tick <= about["last_tick"]:
            give_up_ns = _FOREVER_NS
            if about["host"] == "real_time":
                tick, give_up_ns = self.await_time(tick, start_ns)
            arrived = sum(self.await_input(stream, tick, give_up_ns) << bit for bit, stream in enumerate(self.inputs))
            self.step(tick, 0 if last_step is None else tick - last_step, arrived)
            tick, last_step = tick + about["period"], tick
        self.say("Finished")
        while True:
            self.hear()

    def await_time(self, tick: int, start_ns: int) -> tuple[int, int]:
        """Wait for a tick of the clock, leaving out those that have passed; return it, and when to give up, ns."""
        about, tick_ns = self.about, self.about["tick_ns"]
        now = min((time.monotonic_ns() - start_ns) // tick_ns, about["last_tick"])
        tick = max(tick, now - (now - about["phase"]) % about["period"])
        begins_ns = start_ns + tick * tick_ns
        time.sleep(max(0, begins_ns - time.monotonic_ns()) / 1e9)
        return tick, begins_ns + max(about["grace_ns"], about["period"] * tick_ns // 2)

    def await_input(self, stream: _Stream, tick: int, give_up_ns: int) -> bool:
        """Wait for the sample that is due; after a while take the newest that has come, if any has."""
        due = stream.due(tick)
        while due >= stream.about["phase"] and due not in stream.seen:
            left_ns = give_up_ns - time.monotonic_ns()
            if left_ns <= 0:
                break
            if not stream.take():
                self.await_bell(left_ns / 1e9)
        return stream.keep_newest(due)

    def await_bell(self, seconds: float) -> None:
        called = select.select([self.about["bell"], self.line], [], [], seconds)[0]
        if self.line in called:
            connect = self.hear()["Connect"]
            for stream in self.outputs:
                stream.port.update_connections()
            for stream in self.inputs:
                stream.port.has_samples()
            self.say({"Connected": connect})  # to a restarted service
        elif called:
            os.eventfd_read(self.about["bell"])

    def step(self, tick: int, elapsed: int, arrived: int) -> None:
        tick_ns = self.about["tick_ns"]
        self.bridge.now_words[0] = tick
        self.bridge.now_words.view(np.float64)[1:] = tick * tick_ns / 1e9, elapsed * tick_ns / 1e9
        for stream in self.outputs:
            stream.words[:] = 0
        self.bridge.step(arrived)
        for stream in self.outputs:
            stream.publish(tick, tick_ns)
