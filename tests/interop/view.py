"""Checks a copy of a run log for viewers with programs that are not ours.

    view.py RUN.mcap VIEW.mcap RERUN FOLDER

* Every message of the log is in the copy, byte for byte and in its order.
* What was added is what Foxglove calls so: its own definitions have every type and member that the copy's schemas describe, decode
  each message, leave no byte of it unknown, and find in it what the copy's schemas find.
* Poses are those of the log, at display rate and upright for viewers.
* Rerun finds nothing wrong, and in its recording, written to FOLDER, all frames, poses and points are what it draws as such.

Fails at the first difference, naming it.
"""

import importlib
import math
import re
import struct
import subprocess
import sys
from collections import Counter
from pathlib import Path

import mcap.reader
import mcap_protobuf.decoder
import mcap_ros2.decoder
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.unknown_fields import UnknownFieldSet

from check import Difference, require

PREFIX = "view/"
POSES_A_SECOND = 30

# What each channel carries.
CHANNELS = {
    "view/upright": "FrameTransform",
    "view/scene": "SceneUpdate",
    "view/points": "PointCloud",
    "view/body": "FrameTransform",
    "view/vehicle": "PoseInFrame",
    "view/reference": "PoseInFrame",
}

# What Rerun makes of them.
DRAWN = {
    "view/body": "Transform3D:quaternion",
    "view/upright": "Transform3D:quaternion",
    "view/vehicle": "InstancePoses3D:translations",
    "view/reference": "InstancePoses3D:translations",
    "view/points": "Points3D:positions",
}


def raw_messages(log, is_added):
    """(topic, schema, times, number, bytes) of the log's messages, or of what was added, in the order of the file."""
    with log.open("rb") as stream:
        reader = mcap.reader.make_reader(stream, validate_crcs=True)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.topic.startswith(PREFIX) == is_added:
                times = (message.log_time, message.publish_time)
                kind = (schema.name, schema.encoding, schema.data, channel.message_encoding)
                yield channel.topic, kind, times, message.sequence, message.data


def check_originals(log, copy):
    """Every message of the log is in the copy; returns how many."""
    count = 0
    for original, copied in zip(raw_messages(log, False), raw_messages(copy, False), strict=True):
        require(original == copied, f"{original[0]} at {original[2][0]} ns is another message in the copy")
        count += 1
    return count


def official(name):
    """Foxglove's own class of a message."""
    return getattr(importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)


def check_description(schema_data):
    """Types and members are those of Foxglove, as far as there are any."""
    files = FileDescriptorSet.FromString(schema_data).file
    require([file.package for file in files] == ["google.protobuf", "foxglove"], "other packages than expected")
    members = 0
    for described in files[1].message_type:
        fields = official(described.name).DESCRIPTOR.fields_by_name
        for field in described.field:
            known = fields.get(field.name)
            place = f"foxglove.{described.name}.{field.name}"
            require(known is not None, f"Foxglove has no {place}")
            is_repeated = field.label == field.LABEL_REPEATED
            stated = (field.number, field.type, is_repeated)
            require(stated == (known.number, known.type, known.is_repeated), f"{place} is another one: {stated}")
            members += 1
    require(members > 40, f"only {members} members are described")


def require_known(message, place):
    """No byte of a message, or of one within it, is unknown to its own class."""
    require(len(UnknownFieldSet(message)) == 0, f"{place} has members that Foxglove does not know")
    for field, value in message.ListFields():
        if field.message_type is not None:
            for part in value if field.is_repeated else [value]:
                require_known(part, f"{place}.{field.name}")


def added_messages(copy):
    """(topic, log time, message as Foxglove's own class has it) of what was added."""
    by_the_schema = decoded(copy, mcap_protobuf.decoder.DecoderFactory(), list(CHANNELS))
    for raw, (topic, _, described) in zip(raw_messages(copy, True), by_the_schema, strict=True):
        place = f"{topic} at {raw[2][0]} ns"
        require(topic == raw[0] and raw[1][0] == f"foxglove.{CHANNELS[topic]}", f"{place} is {raw[1][0]}")
        require(raw[1][1] == "protobuf" and raw[1][3] == "protobuf", f"{place} is encoded as {raw[1][3]}")
        message = official(CHANNELS[topic]).FromString(raw[4])
        require_known(message, place)
        require(str(message) == str(described), f"{place} is another message by the copy's own schema")
        yield topic, raw[2][0], message


def decoded(log, factory, topics):
    """(topic, log time, message) of some topics, in the order of the file."""
    with log.open("rb") as stream:
        reader = mcap.reader.make_reader(stream, decoder_factories=[factory])
        for _, channel, message, content in reader.iter_decoded_messages(topics=topics, log_time_order=False):
            yield channel.topic, message.log_time, content


def xyz(vector):
    """The parts of a vector."""
    return (vector.x, vector.y, vector.z)


def matrix(quaternion):
    """The rotation matrix of a quaternion, row-major."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    return (
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
    )  # fmt: skip


def is_near(one, other):
    """Whether numbers are equal but for rounding."""
    return all(math.isclose(a, b, abs_tol=1e-9) for a, b in zip(one, other, strict=True))


def check_poses(log, added):
    """Poses and frames are those of the log, at the times of its samples."""
    topics = ["vehicle/truth", "path/reference"]
    samples = {(topic, time): sample for topic, time, sample in decoded(log, mcap_ros2.decoder.DecoderFactory(), topics)}
    counts = Counter(topic for topic, _, _ in added)
    seconds = max(time for _, time in samples) * 1e-9
    for topic in ("view/body", "view/vehicle", "view/reference"):
        require(counts[topic] == int(seconds * POSES_A_SECOND) + 1, f"{counts[topic]} messages of {topic}")
    for topic in ("view/upright", "view/scene", "view/points"):
        require(counts[topic] == 1, f"{counts[topic]} messages of {topic}")
    for topic, time, message in added:
        place = f"{topic} at {time} ns"
        if topic == "view/upright":
            require((message.parent_frame_id, message.child_frame_id) == ("world_z_up", "world"), place)
            require(is_near(matrix(message.rotation), (1, 0, 0, 0, -1, 0, 0, 0, -1)), f"{place} is not half a turn about x")
        elif topic == "view/body":
            require((message.parent_frame_id, message.child_frame_id) == ("world", "body"), place)
            truth = samples["vehicle/truth", time]
            require(xyz(message.translation) == tuple(truth.position_world), f"{place}: another place")
            require(is_near(matrix(message.rotation), truth.world_from_body), f"{place}: another attitude")
        elif topic in ("view/vehicle", "view/reference"):
            require(message.frame_id == "world", place)
            sample = samples["vehicle/truth" if topic == "view/vehicle" else "path/reference", time]
            require(xyz(message.pose.position) == tuple(sample.position_world), f"{place}: another place")
            if topic == "view/vehicle":
                attitude = sample.world_from_body
            else:
                sine, cosine = math.sin(sample.yaw), math.cos(sample.yaw)
                attitude = (cosine, -sine, 0, sine, cosine, 0, 0, 0, 1)
            require(is_near(matrix(message.pose.orientation), attitude), f"{place}: another attitude")


def check_ways(added):
    """The lines go through the poses, and the points are those of the lines."""
    by_topic = {topic: [message for name, _, message in added if name == topic] for topic in CHANNELS}
    [scene], [cloud] = by_topic["view/scene"], by_topic["view/points"]
    expected = b""
    lines = [entity.lines[0] for entity in scene.entities if entity.lines]
    for line, topic in zip(lines, ("view/vehicle", "view/reference"), strict=True):
        poses = [xyz(message.pose.position) for message in by_topic[topic]]
        require([xyz(point) for point in line.points] == poses, f"a line leaves the poses of {topic}")
    require([field.name for field in cloud.fields] == ["x", "y", "z", "red", "green", "blue", "alpha"], "other points")
    packed = struct.Struct("<3f4B")
    require(cloud.point_stride == packed.size, f"a point has {cloud.point_stride} bytes")
    for line in lines:
        color = [int(255 * part + 0.5) for part in (line.color.r, line.color.g, line.color.b, line.color.a)]
        expected += b"".join(packed.pack(*xyz(point), *color) for point in line.points)
    require(cloud.data == expected, "the points are not those of the lines")


def check_with_rerun(copy, added, rerun, folder):
    """Rerun finds no fault with the copy, and draws every message that it can draw."""

    def run(*arguments):
        result = subprocess.run([rerun, *arguments], capture_output=True, text=True, check=False)
        require(result.returncode == 0, f"rerun {' '.join(arguments)}: {result.stderr}")
        return result.stdout + result.stderr

    verdicts = [line for line in run("mcap", "check", "--full", str(copy)).splitlines() if f"/{PREFIX}" in line and ".mcap" not in line]
    require(len(verdicts) == len(CHANNELS), f"rerun has looked at {verdicts}")
    for verdict in verdicts:
        require(verdict.startswith("ok"), f"rerun says {verdict}")

    recording = str(folder / "view.rrd")
    run("mcap", "convert", str(copy), "--output", recording)
    drawn = Counter()
    for rows, columns in re.findall(r"with (\d+) rows .* - data columns: \[(.*)\]", run("rrd", "print", "-v", recording)):
        drawn.update({column: int(rows) for column in columns.split()})
    counts = Counter(topic for topic, _, _ in added)
    for topic, component in DRAWN.items():
        rows = drawn[f"/{topic}@{component}"]
        require(rows == counts[topic], f"rerun makes {rows} {component} of {counts[topic]} messages of {topic}")


def main(log, copy, rerun, folder):
    """Runs all checks."""
    originals = check_originals(log, copy)
    check_description(next(raw_messages(copy, True))[1][2])
    added = list(added_messages(copy))
    check_poses(log, added)
    check_ways(added)
    check_with_rerun(copy, added, rerun, folder)
    print(f"view: {originals} messages as in the log, {len(added)} for viewers, all as Foxglove defines them; Rerun draws {len(DRAWN)}")


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    try:
        main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], Path(sys.argv[4]))
    except Difference as difference:
        sys.exit(f"not equal: {difference}")
