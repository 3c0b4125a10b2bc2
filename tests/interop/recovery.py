"""Damages a run log, lets `gerono recover` and an independent program recover it, and compares what they find.

    recovery.py RUN.mcap GERONO PYMCAP_CLI FOLDER

One byte in the middle of a chunk is wrong, and the file ends where a later chunk would begin. Both programs must find the
same messages, byte for byte, the independent one must find nothing wrong with the file that `gerono` has written, and
`gerono` must say how many messages there are. Leaves FOLDER/damaged.recovered.mcap. Fails at the first difference, naming it.
"""

import subprocess
import sys
from collections import Counter
from itertools import zip_longest
from pathlib import Path

import mcap.reader

# What `pymcap-cli recover` says of a log that was damaged and of which it has kept something.
RECOVERED_WITH_LOSS = 3


def damage(log, damaged):
    """Writes the damaged log; returns how many chunks are whole in it."""
    with log.open("rb") as stream:
        chunks = mcap.reader.make_reader(stream).get_summary().chunk_indexes
    if len(chunks) < 3:
        sys.exit(f"{log} has only {len(chunks)} chunks")
    wrong, cut = chunks[len(chunks) // 3], chunks[2 * len(chunks) // 3]
    data = bytearray(log.read_bytes()[: cut.chunk_start_offset])
    data[wrong.chunk_start_offset + wrong.chunk_length // 2] ^= 1
    damaged.write_bytes(data)
    return 2 * len(chunks) // 3 - 1


def messages(log):
    """(topic, log time, sequence, bytes) in the order of the file."""
    with log.open("rb") as stream:
        reader = mcap.reader.make_reader(stream, validate_crcs=True)
        for _, channel, message in reader.iter_messages(log_time_order=False):
            yield channel.topic, message.log_time, message.sequence, message.data


def run(*command, expected=0):
    """Runs a command and returns what it prints."""
    ended = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    if ended.returncode != expected:
        sys.exit(f"{command} ended with {ended.returncode}:\n{ended.stdout}{ended.stderr}")
    return ended.stdout


def main(log, gerono, pymcap_cli, folder):
    """Runs all checks."""
    damaged, ours, theirs = (folder / name for name in ("damaged.mcap", "damaged.recovered.mcap", "independent.mcap"))
    whole_chunks = damage(log, damaged)
    said = run(gerono, "recover", damaged)
    # Otherwise it copies chunks without a look at their checksums.
    arguments = (damaged, "-o", theirs, "--no-clobber", "--always-decode-chunk")
    run(pymcap_cli, "recover", *arguments, expected=RECOVERED_WITH_LOSS)
    found = Counter()
    for ours_is, theirs_is in zip_longest(messages(ours), messages(theirs)):
        if ours_is != theirs_is:
            sys.exit(f"not equal: {ours_is and ours_is[:3]} and {theirs_is and theirs_is[:3]}")
        found[ours_is[0]] += 1
    if f"kept {found.total()} samples in {whole_chunks} chunks" not in said:
        sys.exit(f"{found.total()} messages in {whole_chunks} chunks, but said was: {said}")
    run(pymcap_cli, "doctor", ours)
    print(f"pymcap-cli: the same {found.total()} messages of {len(found)} topics are recovered of a damaged log")


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    main(*map(Path, sys.argv[1:]))
