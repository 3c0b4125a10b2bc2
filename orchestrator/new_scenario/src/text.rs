//! The text of a scenario file.

use std::fmt::Write;

use scenario::{GRAVITY, RadioProtocol, Vector};

use crate::estimates::Estimates;
use crate::{Airframe, Implausible, Surroundings};
use scenario_file::gain_rules::Gains;

/// Returns the scenario of a vehicle. `file` is its name in the commands of its first lines.
///
/// # Errors
/// [`Implausible`] if no vehicle has the stated properties.
pub fn text(airframe: &Airframe, surroundings: Surroundings, file: &str) -> Result<String, Implausible> {
    let estimates = Estimates::within(airframe, surroundings)?;
    let parts = [
        beginning(airframe, surroundings, file),
        match surroundings {
            Surroundings::Simulated => simulated_flight(),
            Surroundings::Laboratory { .. } => LABORATORY_FLIGHT.to_owned(),
        },
        connections(surroundings),
        link(airframe, &estimates, surroundings),
        model(airframe, &estimates),
        controller(airframe, &estimates),
        vehicle(airframe, &estimates, surroundings),
    ];
    Ok(parts.concat().lines().map(aligned).collect())
}

/// Column of the comments, as far as values are short enough.
const COMMENTS: usize = 32;

/// Returns a line with its comment in the common column.
fn aligned(line: &str) -> String {
    match line.split_once(" # ") {
        Some((value, comment)) if !line.starts_with('#') => {
            let value = value.trim_end();
            let blanks = COMMENTS.saturating_sub(value.chars().count()).max(2);
            format!("{value}{}# {}\n", " ".repeat(blanks), comment.trim_start())
        }
        _ => format!("{line}\n"),
    }
}

fn in_words(cells: u32) -> String {
    format!("{cells} cell{}", if cells == 1 { "" } else { "s" })
}

fn beginning(airframe: &Airframe, surroundings: Surroundings, file: &str) -> String {
    let Airframe {
        mass,
        size,
        propeller,
        cells,
    } = airframe;
    let cells = in_words(*cells);
    let vehicle = format!("{mass} kg, {size} m from motor to motor, {propeller} inch propellers, {cells}");
    let commands = match surroundings {
        Surroundings::Simulated => format!(
            "#     gerono check {file}\n\
             #     gerono run {file}\n"
        ),
        Surroundings::Laboratory { .. } => format!(
            "#     gerono check {file}\n\
             #     gerono run {file} --set motion_capture.source=simulated --set flight.arm_at=2.0 --set flight.land_at=60.0\n\
             #\n\
             # Then against a simulated laboratory, in three terminals (docs/simulated_laboratory.md), with the addresses that this file\n\
             # has now, which are this machine's; keep a copy of it for later rehearsals:\n\
             #\n\
             #     gerono world {file} --out runs/world\n\
             #     gerono run {file} --host realtime --out runs/flight\n\
             #     gerono arm\n\
             #\n\
             # and only then, with the addresses of your laboratory in `[motion_capture]` and `[rc_output.transmitter]`, with the\n\
             # vehicle: propellers off first. docs/first_flight.md says what to check.\n"
        ),
    };
    format!(
        "# A vehicle that was weighed but not measured: {vehicle}. Written by `gerono new`.\n\
         #\n\
         # A value with \"estimate\" in its comment follows from these numbers by a rule of docs/another_vehicle.md. Replace it when you\n\
         # have measured it; the comment says how.\n\
         #\n\
         {commands}\n\
         description = \"{vehicle}\"\n"
    )
}

fn simulated_flight() -> String {
    "duration = 60.0                 # s\n\
     seed = 1                        # of all random draws: air and cameras\n\
     \n\
     # --- The path: a tilted eight of 1.2 m, 1.2 m above the ground; z points down -----------------------------------------\n\
     [path.curve.tilted_eight]\n"
        .to_owned()
}

const LABORATORY_FLIGHT: &str = r#"duration = 120.0                # s; it lands in time before the end

# --- The path: first a hover, 1.2 m above the ground; z points down ---------------------------------------------------
[path.curve.hover]
position = [0.0, 0.0, -1.2]     # m; later the eight, in place of these two lines: [path.curve.tilted_eight]

# --- Phases, limits, and what services do about samples that are too old; set the limits to your room -----------------
[flight]
spool_up = 1.0                  # s
takeoff_height = 0.8            # m
takeoff_speed = 0.4             # m/s
landing_speed = 0.3             # m/s
position_sigma_max = 0.01       # m
yaw_test = 0.2                  # rad, a turn at lift-off and back, which shows a wrong sign of yaw
# `gerono lab check` prints these three lines for your vehicle; without them a vehicle in a hand, or with wrong axes, is armed, too.
# hand_test = "hand_test.json"
# ground = 0.0                  # m, z of the vehicle on the ground
# ground_tolerance = 0.05       # m

[envelope]
after = 0.05                    # s
land_within = 20.0              # s

[envelope.box]
min = [-1.5, -1.5, -2.2]        # m, z points down: 2.2 m above the origin
max = [1.5, 1.5, 0.5]
margin = 0.5                    # m
action = "land"

[envelope.tilt]
max = 0.8                       # rad
action = "kill"

[envelope.speed]
max = 2.5                       # m/s
action = "land"

[envelope.estimate]
position_sigma = 0.05           # m
action = "warn"

# A kill switch at this machine: `gerono operator probe DEVICE` prints the two lines; docs/kill_switch.md.
# [operator]
# kill_device = "/dev/input/by-id/..."
# kill_key = 57

[safety."vehicle/state -> controller"]
max_age = 0.2                   # s
level = 0.3                     # s
descend = 1.0                   # s
failsafe = 10.0                 # s: on the ground by then
jump = 0.2                      # m
recover = 0.1                   # s

[safety."path/reference -> controller"]
max_age = 0.5                   # s

[safety."vehicle/state -> path_generator"]
max_age = 0.2                   # s
jump = 0.2                      # m

[safety."rc/frame -> path_generator"]
max_age = 0.1                   # s

[safety."control/command -> rc_output"]
max_age = 0.044                 # s
failsafe = 1.0                  # s

[safety."vehicle/state -> rc_output"]
max_age = 0.2                   # s
jump = 0.2                      # m
"#;

/// Returns cameras and estimator, and the times at which services step.
fn connections(surroundings: Surroundings) -> String {
    let mut text = String::from(
        "\n# --- Times: cameras at 100 Hz; a command as often as the radio can use one ---------------------------------------------\n",
    );
    let is_simulated = surroundings == Surroundings::Simulated;
    let (period, why) = match surroundings {
        Surroundings::Simulated => (0.022, "the paper's radio takes a frame every 22 ms".to_owned()),
        Surroundings::Laboratory { radio, .. } => command_period(radio),
    };
    // Writing to a string does not fail.
    let _ = write!(text, "# {why}.\n[schedule.period]\n");
    if is_simulated {
        text += "\"mocap/pose\" = 0.01             # s\n";
    }
    let services = format!(
        "\"vehicle/state\" = {period:?}         # s\npath_generator = {period:?}\ncontroller = {period:?}\nrc_output = {period:?}\n"
    );
    let _ = write!(text, "{services}\n[schedule.phase]\n{services}");
    match surroundings {
        Surroundings::Simulated => {
            text += "\n[schedule.latency]\n\
                     \"mocap/pose -> estimator\" = 0.005  # s, from the exposure to the estimator\n\
                     \"rc/frame -> plant\" = 0.005     # s, from the transmitter to the vehicle\n";
        }
        Surroundings::Laboratory { cameras, .. } => {
            let properties = cameras.properties();
            let (name, title, latency) = (properties.name, properties.title, properties.latency);
            // Writing to a string does not fail.
            let _ = write!(
                text,
                "\n# --- Cameras: {title}; `gerono mocap probe --calibrate` writes this section -----------------------------------\n\
                 [motion_capture]\n\
                 source = \"{name}\"\n\
                 server = \"127.0.0.1\"            # yours: the address of the server\n\
                 interface = \"127.0.0.1\"         # yours: the address of this machine in the cameras' network\n\
                 object = \"quad\"                 # yours: the name of the body\n\
                 latency = {latency:?}                 # s: of the exposure, beyond the stamps; `gerono identify` estimates it with the radio's\n\
                 rate = [90.0, 110.0]            # Hz: yours\n\
                 max_speed = 6.0                 # m/s\n"
            );
        }
    }
    text += "\n[estimator.kalman]\n\
             position_deviation = 3e-4       # m, noise of a pose: `gerono mocap probe` shows it at rest, `gerono identify` in flight\n\
             attitude_deviation = 2e-3       # rad\n";
    if !is_simulated {
        text += "marker_offset_deviation = 0.02  # m: markers beside the centre of mass are estimated; see `gerono identify`\n";
    }
    text
}

/// Returns the period of the commands to a radio, s, and its reason. A command more often than a capture or a frame is not better,
/// and a slower one waits for nothing.
fn command_period(radio: RadioProtocol) -> (f64, String) {
    let properties = radio.properties();
    let (name, rate) = (properties.name, properties.frame_rate);
    if radio == RadioProtocol::Multi {
        return (0.022, "DSMX takes a command every 22 ms over the air".to_owned());
    }
    let of_frames = (1e3 / rate - 1e-6).ceil() / 1e3;
    if of_frames <= CAPTURE_PERIOD {
        let air = if radio == RadioProtocol::Crsf {
            "; ExpressLRS: a packet rate of 150 Hz or more"
        } else {
            ""
        };
        let why = format!(
            "`{name}` carries {rate:.0} frames per second, so each capture leads to a command at once{air}"
        );
        return (CAPTURE_PERIOD, why);
    }
    let why = format!("`{name}` carries {rate:.0} frames per second: a command for each of them");
    (of_frames, why)
}

/// Period of the captures, s.
const CAPTURE_PERIOD: f64 = 0.01;

fn link(airframe: &Airframe, estimates: &Estimates, surroundings: Surroundings) -> String {
    let Airframe {
        mass,
        propeller,
        cells,
        ..
    } = airframe;
    let battery = in_words(*cells);
    let half = number(estimates.thrust_max / 2.0);
    let ratio = estimates.thrust_max / (mass * GRAVITY);
    let [roll, pitch, yaw] = estimates.rate_max;
    let origin = match (estimates.of_crazyflie, estimates.limited) {
        (Some(motors), _) => format!(
            "# The thrust is what a Crazyflie's firmware makes of its largest packet with {motors},\n\
             # {ratio:.1} times the weight; docs/crazyflie.md has other motors. Better: a thrust stand; or `gerono rc identify`"
        ),
        (None, Some(by_propellers)) if (by_propellers - ratio).abs() >= 0.1 => {
            let end = if by_propellers < ratio { "least" } else { "most" };
            estimated(&format!(
                "{ratio:.1} times the weight, the {end} that is assumed: four propellers of {propeller} inch with {battery}\n\
                 # have {by_propellers:.1} times the weight by the rule"
            ))
        }
        _ => estimated(&format!(
            "{ratio:.1} times the weight by {propeller} inch and {battery}"
        )),
    };
    let estimate = if estimates.of_crazyflie.is_some() {
        ""
    } else {
        ": estimate"
    };
    let set = format!(
        "set {:.0}, {:.0} and {:.0} °/s in the flight controller, linear; `gerono rc identify` checks it",
        roll.to_degrees(),
        pitch.to_degrees(),
        yaw.to_degrees()
    );
    let (bits, rates) = match surroundings.radio() {
        Some(RadioProtocol::Crazyflie) => (16, "where the sticks end; the packet has no limits".to_owned()),
        Some(RadioProtocol::Msp) => (10, set),
        _ => (11, set),
    };
    let mut text = format!(
        "\n# --- The radio link: what the ends of its channels mean ---------------------------------------------------------------\n\
         {origin}\n\
         # after a flight of 40 s along a path that moves the thrust. A hover does not; the command says which path does.\n\
         [rc_output]\n\
         thrust_offset = {half}            # N at a thrust channel of 0{estimate}\n\
         thrust_slope = {half}             # N per unit of the channel, so 0 N to {}{estimate}\n\
         rate_slope = [{roll:?}, {:?}, {yaw:?}]  # rad/s per unit: {rates}\n\
         thrust_range = [-1.0, 1.0]\n\
         resolution = {bits}                 # bits from −1 to 1\n",
        newtons(estimates.thrust_max),
        -pitch,
    );
    if let Some(radio) = surroundings.radio() {
        text += &transmitter(radio, *cells);
    }
    text
}

/// Says from what a thrust is estimated, and how to do better.
fn estimated(origin: &str) -> String {
    format!(
        "# The thrust is an estimate, {origin}; a factor of 1.6 either way\n\
         # is usual, and racers have more. Rather state too much than too little. Better: a thrust stand; or `gerono rc identify`"
    )
}

fn transmitter(radio: RadioProtocol, cells: u32) -> String {
    let name = radio.name();
    let (destination, channels) = match radio {
        RadioProtocol::Msp => (
            "tcp = \"127.0.0.1:5761\"          # yours: the flight controller, or device = \"/dev/serial/by-id/…\"",
            true,
        ),
        RadioProtocol::Mavlink => (
            "udp = \"127.0.0.1:14540\"         # yours: the autopilot, or device = \"/dev/serial/by-id/…\"",
            false,
        ),
        RadioProtocol::Crazyflie => (
            "uri = \"udp://127.0.0.1:19850\"   # yours: \"radio://0/80/2M/E7E7E7E7E7\"",
            false,
        ),
        RadioProtocol::Crsf => (
            "device = \"/tmp/gerono-radio\"    # yours: a name in /dev/serial/by-id; `gerono world` makes this one\n\
             # ExpressLRS (docs/elrs_crsf.md): here baud = 400000 and frame_rate = 250.0, and resolution = 10 above",
            true,
        ),
        _ => (
            "device = \"/tmp/gerono-radio\"    # yours: a name in /dev/serial/by-id; `gerono world` makes this one",
            true,
        ),
    };
    let channels = if channels {
        "order = \"AETR\"                  # roll, pitch, thrust, yaw: `gerono rc probe` moves one after the other\n\
         arming_channel = 5              # the arming switch of the vehicle\n"
    } else {
        ""
    };
    // Whether another vehicle sends its voltage depends on its receiver.
    let battery = if radio == RadioProtocol::Crazyflie {
        format!(
            "\n[rc_output.battery]\nlowest = {}                   # V, under load: 3.2 V a cell, as in its firmware\n",
            number(3.2 * f64::from(cells))
        )
    } else {
        String::new()
    };
    format!("link = \"{name}\"\n\n[rc_output.transmitter]\n{destination}\n{channels}{battery}")
}

fn model(airframe: &Airframe, estimates: &Estimates) -> String {
    let Airframe { mass, size, .. } = airframe;
    let Estimates {
        cuboid,
        thrust_lag,
        rate_lag,
        ..
    } = estimates;
    format!(
        "\n# --- What estimator and controller believe of the vehicle --------------------------------------------------------------\n\
         [model]\n\
         mass = {mass:?}                     # kg, by scales, with battery\n\
         size = {}  # m: a cuboid that has the vehicle's inertia, by its diagonal of {size} m: estimate\n\
         thrust_lag = {}              # s, motors and propellers: estimate, may be half or twice; a step on a thrust stand\n\
         rate_lag = {}                # s, the flight controller's rate loop: estimate; its log, or `gerono rc identify`\n\
         radio_latency = 0.005           # s, from the frame to its acting: data sheet; `gerono identify`, when the lags are right\n",
        vector(*cuboid),
        number(*thrust_lag),
        number(rate_lag[0]),
    )
}

fn controller(airframe: &Airframe, estimates: &Estimates) -> String {
    let mass = airframe.mass;
    let (gains, measured) = (Gains::for_unmeasured(mass), Gains::for_measured(mass));
    let learning = number(gains.lambda_disturbance);
    let (mass_max, [yaw_kp, yaw_ki]) = (2.0 * mass, estimates.yaw_gains);
    format!(
        "\n# --- The control law: docs/tuning.md -----------------------------------------------------------------------------------\n\
         # Slow enough for a thrust and lags that are estimates. When they are measured: k1 = {:?}, k2 = {:?} and Λb = {}.\n\
         [controller]\n\
         k1 = {:?}\n\
         k2 = {:?}\n\
         k3 = {:?}\n\
         sigma_max = {:?}\n\
         delta = {:?}                    # δ, m/s\n\
         remove_offset = true\n\
         lambda_mass = {}           # 0.3 (0.2 kg / m)²\n\
         lambda_disturbance = [{learning}, {learning}, {learning}]  # (k2 σmax)²/2, for a damping of 0.71\n\
         \n\
         [controller.bounds]\n\
         mass_min = {}                 # kg: half of the mass; a thrust above the stated one looks like a lighter vehicle\n\
         mass_max = {}                 # kg: twice the mass; state the largest load that you carry if it is more\n\
         epsilon_eta = {}           # 1/kg, below 1/mass_max\n\
         \n\
         [controller.initial]\n\
         mass = {mass:?}                     # kg, by scales\n\
         inertia = {}  # kg m²: estimate, a factor of three does no harm; a bifilar pendulum. β and Λw follow\n\
         \n\
         [controller.rates]              # body rates, not torque\n\
         yaw_kp = {yaw_kp:?}\n\
         yaw_ki = {yaw_ki:?}\n",
        measured.k1,
        measured.k2,
        number(measured.lambda_disturbance),
        gains.k1,
        gains.k2,
        gains.k3,
        gains.sigma_max,
        gains.delta,
        number(gains.lambda_mass),
        number(0.5 * mass),
        number(mass_max),
        number(0.02 / mass_max),
        vector(estimates.inertia),
    )
}

fn vehicle(airframe: &Airframe, estimates: &Estimates, surroundings: Surroundings) -> String {
    let mass = airframe.mass;
    let [lag, _, yaw_lag] = estimates.rate_lag.map(number);
    let (start, initial_thrust) = match surroundings {
        Surroundings::Simulated => (
            "\n[vehicle.initial]\nposition = [0.4, 0.2, -0.8]     # m, in the air, 0.7 m from the start of the path\n",
            format!(
                "initial_thrust = {}          # N: its weight, until the first frame\n",
                number(mass * GRAVITY)
            ),
        ),
        Surroundings::Laboratory { .. } => ("", String::new()),
    };
    format!(
        "\n# --- The vehicle of a simulation; a flight in a laboratory reads none of this ------------------------------------------\n\
         # Here the estimates are true{}. Make them wrong, and see whether it flies: docs/tuning.md.\n\
         [vehicle]\n\
         mass = {mass:?}                     # kg\n\
         inertia = {}  # kg m²: estimate\n\
         {start}\n\
         [vehicle.actuators]\n\
         thrust_lag = {}              # s: estimate\n\
         rate_lag = [{lag}, {lag}, {yaw_lag}]  # s: estimate\n\
         thrust_max = {}               # N{}\n\
         rate_max = {}  # rad/s\n\
         {initial_thrust}\
         \n\
         [vehicle.turbulence]\n\
         deviation = 0.05                # m/s²: the air of a room with people and machines\n\
         correlation_time = 1.0          # s\n\
         \n\
         [cameras]\n\
         position_deviation = 3e-4       # m\n\
         attitude_deviation = 2e-3       # rad\n",
        match surroundings {
            Surroundings::Simulated => "",
            Surroundings::Laboratory { .. } =>
                "; in simulated time cameras and radio have no latency, in `gerono world` the stated ones",
        },
        vector(estimates.inertia),
        number(estimates.thrust_lag),
        number(estimates.thrust_max),
        if estimates.of_crazyflie.is_some() {
            ""
        } else {
            ": estimate"
        },
        vector(estimates.rate_max),
    )
}

/// Formats a number with three digits, as TOML.
fn number(value: f64) -> String {
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    format!("{rounded:?}")
}

fn vector(elements: Vector) -> String {
    format!("[{}]", elements.map(number).join(", "))
}

fn newtons(thrust: f64) -> String {
    format!("{} N", number(thrust))
}
