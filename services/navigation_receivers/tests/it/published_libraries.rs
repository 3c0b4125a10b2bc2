//! Packets of published libraries are read as these read them.

use navigation_receivers::Packet;
use navigation_receivers::stream::Stream;
use navigation_receivers::ubx::Heading;
use shared_types::gnss::FixKind;

use crate::vectors;

/// Numbers of a packet, by their names in the vectors.
struct Numbers(Vec<(String, f64)>);

impl Numbers {
    fn number(&mut self, name: &str, number: impl Into<f64>) -> &mut Self {
        self.0.push((name.to_owned(), number.into()));
        self
    }

    fn optional<T: Into<f64>>(&mut self, name: &str, number: Option<T>) -> &mut Self {
        self.number(name, number.map_or(f64::NAN, Into::into))
    }

    fn vector<const N: usize>(&mut self, name: &str, vector: Option<[f64; N]>) -> &mut Self {
        for (index, number) in vector.unwrap_or([f64::NAN; N]).into_iter().enumerate() {
            self.number(&format!("{name}{index}"), number);
        }
        self
    }

    fn named<const N: usize>(&mut self, names: [&str; N], numbers: [f64; N]) -> &mut Self {
        for (name, number) in names.iter().zip(numbers) {
            self.number(name, number);
        }
        self
    }

    fn kind(&mut self, kind: Option<FixKind>) -> &mut Self {
        self.optional("kind", kind.map(|kind| kind as u8))
    }

    fn heading(&mut self, heading: Option<Heading>) -> &mut Self {
        self.optional("heading", heading.map(|heading| heading.angle));
        self.optional("heading_deviation", heading.map(|heading| heading.deviation))
    }
}

const ACCURACIES: [&str; 3] = ["horizontal_accuracy", "vertical_accuracy", "speed_accuracy"];

#[expect(clippy::cast_precision_loss, reason = "so does the reader of the vectors")]
fn numbers(packet: &Packet) -> Numbers {
    let mut all = Numbers(Vec::new());
    match packet {
        Packet::NavPvt(pvt) => {
            all.number("time_of_week_ms", pvt.time_of_week_ms)
                .optional("utc_us", pvt.utc_ns.map(|ns| ns.div_euclid(1000) as f64))
                .optional("utc_rest_ns", pvt.utc_ns.map(|ns| ns.rem_euclid(1000) as f64))
                .number("time_accuracy", pvt.time_accuracy)
                .number("solution", pvt.solution as u8)
                .number("is_valid", pvt.is_valid)
                .number("has_corrections", pvt.has_corrections)
                .number("carrier", pvt.carrier as u8)
                .kind(pvt.kind())
                .number("satellites", pvt.satellites)
                .number("latitude", pvt.latitude)
                .number("longitude", pvt.longitude)
                .number("height", pvt.height)
                .number("height_above_sea", pvt.height_above_sea)
                .named(["north", "east", "down"], pvt.velocity_ned)
                .named(
                    ACCURACIES,
                    [pvt.horizontal_accuracy, pvt.vertical_accuracy, pvt.speed_accuracy],
                )
                .number("position_dilution", pvt.position_dilution)
                .heading(pvt.heading);
        }
        Packet::RelativePosition(relative) => {
            all.number("time_of_week_ms", relative.time_of_week_ms)
                .named(["north", "east", "down"], relative.baseline_ned)
                .named(
                    ["north_accuracy", "east_accuracy", "down_accuracy"],
                    relative.accuracies_ned,
                )
                .number("length", relative.length)
                .number("carrier", relative.carrier as u8)
                .number("is_valid", relative.is_valid)
                .number("is_moving", relative.is_moving)
                .heading(relative.heading);
        }
        Packet::Heartbeat(_, heartbeat) => {
            all.number("autopilot", heartbeat.autopilot)
                .number("kind", heartbeat.kind)
                .number("is_armed", heartbeat.is_armed);
        }
        Packet::GpsRawInt(_, fix) => {
            all.number("time_us", fix.time_us as f64)
                .number("fix_type", fix.fix_type)
                .kind(fix.kind())
                .optional("satellites", fix.satellites)
                .number("latitude", fix.latitude)
                .number("longitude", fix.longitude)
                .number("height_above_sea", fix.height_above_sea)
                .optional("height", fix.height)
                .optional("ground_speed", fix.ground_speed)
                .optional("course", fix.course)
                .named(ACCURACIES, fix.accuracies.unwrap_or([f64::NAN; 3]))
                .heading(fix.heading);
        }
        Packet::HighresImu(_, sample) => {
            all.number("time_us", sample.time_us as f64)
                .number("sensor", sample.sensor)
                .vector("force", sample.specific_force_body)
                .vector("rate", sample.angular_velocity_body)
                .vector("field", sample.field_body)
                .vector("pressure", sample.pressure.map(|number| [number]))
                .vector(
                    "pressure_altitude",
                    sample.pressure_altitude.map(|number| [number]),
                )
                .vector("temperature", sample.temperature.map(|number| [number]));
        }
        Packet::Odometry(_, motion) => {
            let [frame, child_frame] = motion.frames;
            all.number("time_us", motion.time_us as f64)
                .number("frame", frame)
                .number("child_frame", child_frame)
                .number("resets", motion.resets)
                .vector("position", Some(motion.position))
                .vector("quaternion", Some(motion.quaternion))
                .vector("velocity", motion.velocity)
                .vector("rate", motion.angular_velocity_body)
                .vector("position_variance", motion.position_variances)
                .vector("velocity_variance", motion.velocity_variances);
        }
    }
    all.0.sort_by(|first, second| first.0.cmp(&second.0));
    all
}

#[test]
fn packets_of_published_libraries_mean_what_these_read() {
    let packets = match std::env::var_os("GERONO_RECEIVER_PACKETS") {
        Some(path) => vectors::read(&std::fs::read_to_string(path).unwrap()),
        None => vectors::committed(),
    };
    for vector in &packets {
        let mut stream = Stream::default();
        let mut read = Vec::new();
        stream.push(&vector.bytes, &mut |packet| read.push(*packet));
        let [packet] = read[..] else {
            panic!("{}: {:?} {:?}", vector.message, vector.bytes, stream.counts());
        };
        assert_eq!(packet.message().name(), vector.message);
        assert_eq!(stream.counts().skipped, 0);
        let mut expected = vector.numbers.clone();
        expected.sort_by(|first, second| first.0.cmp(&second.0));
        for ((name, number), (expected_name, expected)) in numbers(&packet).0.iter().zip(&expected) {
            assert_eq!(name, expected_name, "{}", vector.message);
            let is_same = number.is_nan() && expected.is_nan()
                || (number - expected).abs() <= 1e-12 * expected.abs().max(1.0);
            assert!(is_same, "{} {name}: {number} {expected}", vector.message);
        }
        assert_eq!(numbers(&packet).0.len(), expected.len(), "{}", vector.message);
    }
    println!("{} packets read as their writers read them", packets.len());
}
