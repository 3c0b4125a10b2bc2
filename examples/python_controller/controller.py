"""A hover controller that flies in place of Gerono's own: README.md beside it says more, docs/process_contract.md all."""
import ctypes, json, math, os, re, select, socket, sys, time
import iceoryx2 as iox2

HEADER, FAILSAFE, FOREVER = 3 * ctypes.c_uint64, 2, 1 << 62  # tick, stamp_ns and seq; a mode of control/command; ns
TYPES = {"float64": ctypes.c_double, "uint64": ctypes.c_uint64, "uint32": ctypes.c_uint32, "uint8": ctypes.c_uint8}
TYPES |= {"bool": ctypes.c_uint8, "gerono_msgs/Header": HEADER}
MASS, INERTIA, GRAVITY = 0.2, (6.5e-4, 6.5e-4, 13.0e-4), 9.81  # kg, kg m², m/s²
POSITION_GAIN, VELOCITY_GAIN, ATTITUDE_GAIN, RATE_GAIN = 4.0, 4.0, 225.0, 30.0  # 1/s², 1/s, 1/s², 1/s

def control_law(state, reference):
    """Members of control/command and control/errors: proportional and derivative, the attitude in SO(3); z points down."""
    R, omega = state.world_from_body, state.angular_velocity_body
    velocity = [sum(R[3 * i + j] * state.velocity_body[j] for j in range(3)) for i in range(3)]
    error = [p - pd for p, pd in zip(state.position_world, reference.position_world)]
    wanted = [MASS * (POSITION_GAIN * e + VELOCITY_GAIN * v + g) for e, v, g in zip(error, velocity, (0, 0, GRAVITY))]
    x, y, z = (sum(R[3 * i + j] * wanted[i] for i in range(3)) for j in range(3))  # what T R e3 should be, in {B}
    length, yaw_error = math.sqrt(x * x + y * y + z * z), math.atan2(R[3], R[0]) - reference.yaw
    turn = (-y / length, x / length, -math.sin(yaw_error))  # e3 to where the force shall point
    torque = tuple(j * (ATTITUDE_GAIN * t - RATE_GAIN * w) for j, t, w in zip(INERTIA, turn, omega))
    return {"thrust": max(z, 0.0), "torque_body": torque}, {"z1": tuple(error)}

def join(stream):
    """A topic and our port of it, its samples made of their definition; iceoryx2 refuses another type, size or layout."""
    own = stream["msg"].split("=" * 80)[0]  # what follows says what a Header is; members with an `=` are constants
    members = re.findall(r"^([\w/]+)(?:\[(\d+)\])? (\w+)$", own, re.MULTILINE)
    fields = [(name, TYPES[kind] * int(length) if length else TYPES[kind]) for kind, length, name in members]
    stream["sample"] = type("Sample", (ctypes.Structure,), {"_fields_": fields, "type_name": lambda: stream["type"]})
    layout = iox2.AttributeKey.new("layout"), iox2.AttributeValue.new(stream["attributes"]["layout"])
    builder = node.service_builder(iox2.ServiceName.new(stream["topic"])).publish_subscribe(stream["sample"])
    service = builder.open_with_attributes(iox2.AttributeVerifier.new().require(*layout))
    if "buffer" in stream:
        return stream, service.subscriber_builder().buffer_size(stream["buffer"]).create()
    return stream, service.publisher_builder().backpressure_strategy(iox2.BackpressureStrategy.DiscardData).create()

def hear():
    message = json.loads(line.recv(1 << 17) or '"Stop"')  # the end of the line is that of the run
    return sys.exit() if message == "Stop" else message

def newest(stream, subscriber, tick, give_up_ns):
    """The sample that is due at a tick; in real time after a while the newest that has come, if any has."""
    due = tick - stream["latency"] - (tick - stream["latency"] - stream["phase"]) % stream["period"]
    while due >= stream["phase"] and due not in stream["seen"] and (left_ns := give_up_ns - time.monotonic_ns()) > 0:
        if received := subscriber.receive():
            sample = stream["sample"].from_buffer_copy(received.payload().contents)
            stream["seen"][sample.header[0]] = sample
        elif line in (called := select.select([about["bell"], line], [], [], left_ns / 1e9)[0]):
            [port.update_connections() for _, port in outputs] + [port.has_samples() for _, port in inputs]
            line.send(json.dumps({"Connected": hear()["Connect"]}).encode())  # to a restarted service
        elif called:
            os.eventfd_read(about["bell"])
    found = max((seen for seen in stream["seen"] if seen <= due), default=-1)
    stream["seen"] = {seen: sample for seen, sample in stream["seen"].items() if seen >= found}
    return stream["seen"].get(found)

line, about = socket.socket(fileno=3), json.load(open(4))
assert about["contract"] == 1 and hear() == "MakePorts"
config = iox2.FilePath.new(about["iceoryx2_configuration"])
node = iox2.NodeBuilder.new().config(iox2.config.from_file(config)).create(iox2.ServiceType.Ipc)
inputs, outputs = ([join({**stream, "seen": {}}) for stream in about[kind]] for kind in ("inputs", "outputs"))
line.send(json.dumps({"Ready": {"receivers": [f"{port.id.value:x}" for _, port in inputs]}}).encode())
start_ns, tick, period, tick_ns = hear()["Go"]["start_ns"], about["phase"], about["period"], about["tick_ns"]
while tick <= about["last_tick"]:
    give_up_ns = FOREVER
    if about["host"] == "real_time":  # steps whose time has passed are left out
        now = min((time.monotonic_ns() - start_ns) // tick_ns, about["last_tick"])
        tick = max(tick, now - (now - about["phase"]) % period)
        give_up_ns = start_ns + tick * tick_ns + max(about["grace_ns"], period * tick_ns // 2)
        time.sleep(max(0, start_ns + tick * tick_ns - time.monotonic_ns()) / 1e9)
    state, reference = (newest(*one, tick, give_up_ns) for one in inputs)
    is_known = state and state.tracked and reference
    command, errors = control_law(state, reference) if is_known else ({"mode": FAILSAFE}, {})
    for (stream, publisher), members in zip(outputs, (command, {}, errors)):
        header = HEADER(tick, tick * tick_ns, (tick - stream["phase"]) // stream["period"])
        publisher.send_copy(stream["sample"](header=header, **members))
        [os.eventfd_write(bell, 1) for bell in stream["bells"]]
    tick += period
line.send(b'"Finished"')
while hear(): pass
