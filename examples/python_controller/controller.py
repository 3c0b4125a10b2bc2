"""A hover controller that flies in place of Gerono's own: README.md beside it says more, docs/process_contract.md all."""

import ctypes, json, math, os, re, select, socket, sys, time
import iceoryx2 as iox2

HEADER = ctypes.c_uint64 * 3  # tick, stamp_ns, seq
TYPES = {"gerono_msgs/Header": HEADER, "float64": ctypes.c_double, "uint64": ctypes.c_uint64, "bool": ctypes.c_uint8}
TYPES |= {"uint32": ctypes.c_uint32, "uint16": ctypes.c_uint16, "uint8": ctypes.c_uint8}
MASS, INERTIA, GRAVITY, FAILSAFE = 0.2, (6.5e-4, 6.5e-4, 13.0e-4), 9.81, 2  # kg, kg m², m/s², a mode of control/command
POSITION_GAIN, VELOCITY_GAIN, ATTITUDE_GAIN, RATE_GAIN = 4.0, 4.0, 225.0, 30.0  # 1/s², 1/s, 1/s², 1/s


def structure(stream):
    """The ctypes structure of a topic's samples, made of its message definition."""
    own = stream["msg"].split("=" * 80)[0]  # then come the members of Header; what has an `=` is a constant
    members = re.findall(r"^([\w/]+)(?:\[(\d+)\])? (\w+)$", own, re.MULTILINE)
    fields = [(name, TYPES[kind] * int(length) if length else TYPES[kind]) for kind, length, name in members]
    made = type("Sample", (ctypes.Structure,), {"_fields_": fields, "type_name": staticmethod(lambda: stream["type"])})
    assert ctypes.sizeof(made) == stream["size"], f"{stream['topic']} is laid out in another way"
    return made


def control_law(state, reference):
    """Thrust, N, torque in {B}, N m, position error, m: proportional and derivative, attitude in SO(3), z points down."""
    R, omega = state.world_from_body, state.angular_velocity_body
    velocity = [sum(R[3 * i + j] * state.velocity_body[j] for j in range(3)) for i in range(3)]
    error = [p - pd for p, pd in zip(state.position_world, reference.position_world)]
    wanted = [MASS * (POSITION_GAIN * e + VELOCITY_GAIN * v + g) for e, v, g in zip(error, velocity, (0, 0, GRAVITY))]
    x, y, z = (sum(R[3 * i + j] * wanted[i] for i in range(3)) for j in range(3))  # what T R e3 should be, in {B}
    length, yaw_error = math.sqrt(x * x + y * y + z * z), math.atan2(R[3], R[0]) - reference.yaw
    turn = (-y / length, x / length, -math.sin(yaw_error))  # e3 to where the force shall point
    return z, [j * (ATTITUDE_GAIN * t - RATE_GAIN * w) for j, t, w in zip(INERTIA, turn, omega)], error


def hear():
    message = json.loads(line.recv(1 << 17) or '"Stop"')  # the end of the line is that of the run
    return sys.exit() if message == "Stop" else message


def rest(until_ns):
    """Sleeps until somebody rings or the orchestrator speaks, or until a time has come, if one is given."""
    limit = None if until_ns is None else max(0, until_ns - time.monotonic_ns()) / 1e9
    for called in select.select([about["bell"], line], [], [], limit)[0]:
        if called == about["bell"]:
            os.eventfd_read(called)
        elif "Connect" in (message := hear()):  # to a service that was born again
            all([port.update_connections() for _, port in outputs] + [port.has_samples() for _, port in inputs])
            line.send(json.dumps({"Connected": message["Connect"]}).encode())


def newest(stream, port, tick, give_up_ns):
    """The sample that is due at a tick, or in real time after a while the newest that has come, if any has."""
    due = tick - stream["latency"] - (tick - stream["latency"] - stream["phase"]) % stream["period"]
    while due >= stream["phase"]:
        while (sample := port.receive()) is not None:
            copy = stream["structure"].from_buffer_copy(sample.payload().contents)
            stream["samples"][copy.header[0]] = copy
        if due in stream["samples"] or (give_up_ns and time.monotonic_ns() >= give_up_ns):
            break
        rest(give_up_ns)
    found = max((tick for tick in stream["samples"] if tick <= due), default=-1)
    stream["samples"] = {tick: sample for tick, sample in stream["samples"].items() if tick >= found}
    return stream["samples"].get(found)


def port(stream):
    """The topic with our port of it; iceoryx2 refuses another type, size or layout."""
    stream["structure"], stream["samples"] = structure(stream), {}
    layout = iox2.AttributeKey.new("layout"), iox2.AttributeValue.new(stream["attributes"]["layout"])
    builder = node.service_builder(iox2.ServiceName.new(stream["topic"])).publish_subscribe(stream["structure"])
    service = builder.open_with_attributes(iox2.AttributeVerifier.new().require(*layout))
    if "buffer" in stream:
        return stream, service.subscriber_builder().buffer_size(stream["buffer"]).create()
    return stream, service.publisher_builder().backpressure_strategy(iox2.BackpressureStrategy.DiscardData).create()


line, about = socket.socket(fileno=3), json.load(open(4))
assert hear() == "MakePorts"
config = iox2.config.from_file(iox2.FilePath.new(about["iceoryx2_configuration"]))
node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
inputs, outputs = [port(stream) for stream in about["inputs"]], [port(stream) for stream in about["outputs"]]
line.send(json.dumps({"Ready": {"receivers": [f"{port.id.value:x}" for _, port in inputs]}}).encode())
start_ns, tick, period, tick_ns = hear()["Go"]["start_ns"], about["phase"], about["period"], about["tick_ns"]
while tick <= about["last_tick"]:
    give_up_ns = None
    if about["host"] == "real_time":  # steps whose time has passed are left out
        now = min((time.monotonic_ns() - start_ns) // tick_ns, about["last_tick"])
        tick = max(tick, now - (now - about["phase"]) % period)
        begins_ns = start_ns + tick * tick_ns
        give_up_ns = begins_ns + max(about["grace_ns"], period * tick_ns // 2)
        while time.monotonic_ns() < begins_ns:
            rest(begins_ns)
    state, reference = (newest(stream, port, tick, give_up_ns) for stream, port in inputs)
    values = {"control/command": {"mode": FAILSAFE}}
    if state and state.tracked and reference:
        thrust, torque, error = control_law(state, reference)
        values = {"control/command": {"thrust": thrust, "torque_body": tuple(torque)}, "control/errors": {"z1": tuple(error)}}
    for stream, port in outputs:
        if (tick - stream["phase"]) % stream["period"] == 0:
            header = HEADER(tick, tick * tick_ns, (tick - stream["phase"]) // stream["period"])
            port.send_copy(stream["structure"](header=header, **values.get(stream["topic"], {})))
            [os.eventfd_write(bell, 1) for bell in stream["bells"]]
    tick += period
line.send(b'"Finished"')
while True:
    hear()
