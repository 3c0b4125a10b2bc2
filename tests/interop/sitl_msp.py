"""Questions to a simulated Betaflight in MSP."""

import socket


def connect(address, port):
    return socket.create_connection((address, int(port)), timeout=10)


def ask(line, command):
    """Returns the payload of the answer to a request without a payload."""
    line.sendall(b"$M<" + bytes([0, command, command]))
    answer = b""
    while len(answer) < 6 or len(answer) < 6 + answer[3]:
        piece = line.recv(4096)
        assert piece, f"ended after {answer!r}"
        answer += piece
    assert answer[:3] == b"$M>" and answer[4] == command, answer
    return answer[5:]
