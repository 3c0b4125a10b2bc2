"""Types commands into the command line of a simulated Betaflight: sitl_settings.py ADDRESS PORT [COMMAND]...

Waits until it listens. With no command that is all."""

import socket
import sys
import time

address, port, *commands = sys.argv[1:]
patience = time.monotonic() + 30
while True:
    try:
        line = socket.create_connection((address, int(port)), timeout=10)
        break
    except ConnectionRefusedError:
        assert time.monotonic() < patience, "nobody listens"
        time.sleep(0.05)


def until(mark):
    seen = b""
    while mark not in seen:
        piece = line.recv(4096)
        assert piece, f"ended after {seen!r}"
        seen += piece


if commands:
    line.sendall(b"#")
    until(b"\r\n# ")
for command in commands:
    line.sendall(command.encode() + b"\n")
    until(b"Rebooting" if command == "save" else b"\r\n# ")
