"""Compares every value of a run log, as two independent programs decode it, with what `gerono export` says.

    check.py RUN.mcap EXPORT.jsonl EVERY

EXPORT.jsonl is `gerono export RUN.mcap --every EVERY`: the samples of every EVERY-th tick. Both decoders know
of our samples only what the log itself says (its `ros2msg` schemas), and decode all of them. Fails at the first
difference, naming it.
"""

import json
import math
import sys
from collections import Counter
from itertools import zip_longest
from pathlib import Path

import mcap.reader
import mcap_ros2.decoder
import rosbags.highlevel

MESSAGE_SEQUENCE_MODULUS = 2**32


class Difference(Exception):
    """Something that is not as it should be."""


def require(condition, text):
    """Fails with `text` unless `condition` holds."""
    if not condition:
        raise Difference(text)


def is_equal(decoded, exported):
    """Whether a decoded value is the exported one, to the bit for numbers."""
    if isinstance(exported, dict):
        return all(is_equal(getattr(decoded, name), value) for name, value in exported.items())
    if isinstance(exported, list):
        return len(decoded) == len(exported) and all(map(is_equal, decoded, exported))
    if isinstance(exported, bool):
        return bool(decoded) is exported
    if isinstance(exported, str):
        number = float(exported)
        return decoded == number or (math.isnan(decoded) and math.isnan(number))
    if isinstance(exported, float):
        return float(decoded).hex() == exported.hex()
    return int(decoded) == exported and float(decoded).is_integer()


def with_mcap(log):
    """(topic, log time, sequence, message) in the order of the file, by PyPI `mcap` and `mcap-ros2-support`."""
    with log.open("rb") as stream:
        reader = mcap.reader.make_reader(
            stream, validate_crcs=True, decoder_factories=[mcap_ros2.decoder.DecoderFactory()]
        )
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            require(message.publish_time == message.log_time, f"{channel.topic}: publish time differs from log time")
            yield channel.topic, message.log_time, message.sequence, decoded


def with_rosbags(log):
    """(topic, log time, nothing, message) in the order of the file, by PyPI `rosbags`.

    It also serialises each message again, which must give the bytes of the log.
    """
    with rosbags.highlevel.AnyReader([log]) as reader:
        for connection, log_time, raw in reader.messages():
            decoded = reader.deserialize(raw, connection.msgtype)
            again = reader.typestore.serialize_cdr(decoded, connection.msgtype)
            require(bytes(again) == bytes(raw), f"{connection.topic} at {log_time} ns: other bytes when serialised again")
            yield connection.topic, log_time, None, decoded


def exported_samples(export):
    """The lines of the export."""
    with export.open(encoding="utf-8") as lines:
        yield from map(json.loads, lines)


def check(decoder, log, export, every):
    """Compares what a decoder finds with the export; returns how many messages it found of each topic."""
    found = Counter()

    def decoded_samples():
        for sample in decoder(log):
            found[sample[0]] += 1
            if sample[3].header.tick % every == 0:
                yield sample

    for decoded, exported in zip_longest(decoded_samples(), exported_samples(export)):
        require(exported is not None, f"{decoded and decoded[:2]} is in the log but not in the export")
        place = f"{exported['topic']} at {exported['log_time']} ns"
        require(decoded is not None, f"{place} is in the export but not in the log")
        topic, log_time, sequence, message = decoded
        require((topic, log_time) == (exported["topic"], exported["log_time"]), f"{place} is {topic} at {log_time} ns")
        expected_sequence = exported["sequence"] % MESSAGE_SEQUENCE_MODULUS
        require(sequence in (None, expected_sequence), f"{place}: sequence {sequence}, not {expected_sequence}")
        for name, value in exported["sample"].items():
            require(is_equal(getattr(message, name), value), f"{place}: {name} is {getattr(message, name)}, not {value}")
    return found


def check_frame(log):
    """Checks what the file says of itself; returns the number of messages of each topic."""
    with log.open("rb") as stream:
        reader = mcap.reader.make_reader(stream, validate_crcs=True)
        header, summary = reader.get_header(), reader.get_summary()
        manifests = [metadata for metadata in reader.iter_metadata() if metadata.name == "gerono"]
    require((header.profile, header.library) == ("ros2", "gerono"), f"header is {header}")
    require(len(manifests) == 1, f"{len(manifests)} manifests")
    manifest = manifests[0].metadata
    require(json.loads(manifest["scenario"])["seed"] == int(manifest["seed"]), "the manifest's seeds differ")
    counts = summary.statistics.channel_message_counts
    for channel in summary.channels.values():
        require(channel.message_encoding == "cdr", f"{channel.topic} is encoded as {channel.message_encoding}")
        require(summary.schemas[channel.schema_id].encoding == "ros2msg", f"{channel.topic} has another kind of schema")
        require(channel.metadata["layout"] == manifest[f"layout/{channel.topic}"], f"{channel.topic} has two layouts")
    return Counter({channel.topic: counts[id] for id, channel in summary.channels.items() if id in counts})


def main(log, export, every):
    """Runs all checks."""
    stated = check_frame(log)
    require(stated.total() > 0, "the log is empty")
    for decoder in (with_mcap, with_rosbags):
        found = check(decoder, log, export, every)
        require(found == stated, f"{decoder.__name__} finds {found}, the statistics say {stated}")
        print(f"{decoder.__name__}: {found.total()} messages of {len(found)} topics, all values that were exported are equal")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    try:
        main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
    except Difference as difference:
        sys.exit(f"not equal: {difference}")
