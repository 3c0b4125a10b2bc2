//! Vehicles as their receivers read pulses, and the calibration, ends, reversals and slopes that describe each of them.
//!
//! A vehicle is stated in pulses of its flight controller: where its motors begin to pull, where they pull most, and how
//! fast it turns. It knows nothing of sticks. How one describes it to a transmitter is derived here, in every way there
//! is, so that the meaning of a frame can be judged without the map under test.

use radio_link::sticks::{Sticks, ThrustRest};
use rc_output::link::Link;
use scenario::{Mavlink, MavlinkMessage, RadioProtocol, RcLink, Transmitter};
use shared_types::samples::{ControlCommand, RcFrame};
use zerocopy::FromZeros;

/// Largest thrust of every vehicle, N.
pub const LARGEST: f64 = 5.4;
/// Largest rates of every vehicle, rad/s.
const RATES: [f64; 3] = [19.0, 18.0, 8.0];

/// Vehicle with a receiver.
#[derive(Clone, Copy, Debug)]
pub struct Vehicle {
    /// Pulses, µs, up to which the motors stand still and at which they pull most: in either order.
    pub thrust: [f64; 2],
    /// Pulses, µs, of no rate and of the rate below about each axis.
    pub rates: [[f64; 2]; 3],
    /// Rate at the second pulse about each axis, rad/s, with its sign.
    pub rate: [f64; 3],
}

/// Vehicle and one description of it.
#[derive(Clone, Debug)]
pub struct Case {
    /// The vehicle, by its channels or by the share of its thrust.
    pub vehicle: Vehicle,
    /// Share of the thrust up to which its motors stand still, for messages without channels.
    pub idle_share: f64,
    /// Its description.
    pub link: RcLink,
    /// Largest error of the thrust, N, and of a rate, rad/s: two steps of the link and one of the stick.
    pub tolerance: [f64; 2],
}

/// Command to the transmitter, and the thrust and rates that it asks for; `None` for those that stop the motors.
pub type Asked = (Sticks, Option<[f64; 4]>);

impl Case {
    /// Largest thrust, N, at which the motors stand still: that of 1 µs where they begin to pull at the very end of the
    /// channel, which Betaflight reads half a microsecond off; none where they stand still in a part of it.
    pub fn stopped(&self) -> f64 {
        let [none, full] = self.vehicle.thrust;
        if self.idle_share > 0.01 {
            0.0
        } else {
            LARGEST / (full - none).abs()
        }
    }
}

/// Half the way from −100 to 100 % of a link, µs, as flight controllers read it.
fn half(link: RadioProtocol) -> f64 {
    match link {
        RadioProtocol::Crsf | RadioProtocol::Sbus => 512.0,
        _ => 500.0,
    }
}

/// Pulses that begin to turn the motors and turn them most, of a link's vehicles with a thrust channel from `low` to
/// `high`, µs.
fn thrusts([low, high]: [f64; 2]) -> Vec<[f64; 2]> {
    let width = high - low;
    let mut found = vec![
        [low, high],
        [high, low],
        // As in the paper, the motors stand still in the first part of the channel.
        [low + 0.13 * width, high],
        [high - 0.13 * width, low],
    ];
    if low <= 1000.0 && high >= 2000.0 {
        // Betaflight: no throttle below `min_check`, 1050 µs, then in proportion up to 2000 µs (`calculateThrottle`
        // and the page "Rx" of its documentation).
        found.push([1050.0, 2000.0]);
        // ArduPilot, RC3_MIN 1000, RC3_MAX 2000, RC3_DZ 30: in proportion from 1030 µs to 2000 µs; with RC3_REVERSED
        // in that of 3000 µs less the pulse (`RC_Channel::pwm_to_range_dz`, parameters RCx_* of its documentation).
        found.extend([[1030.0, 2000.0], [1970.0, 1000.0]]);
    }
    found
}

/// Returns every link, by MAVLink with both messages.
pub fn protocols() -> impl Iterator<Item = (RadioProtocol, MavlinkMessage)> {
    let with_channels = RadioProtocol::ALL.map(|link| (link, MavlinkMessage::RcOverride));
    let without = (RadioProtocol::Mavlink, MavlinkMessage::AttitudeTarget);
    with_channels.into_iter().chain([without])
}

/// Every vehicle in every description.
pub fn cases() -> Vec<Case> {
    let mut found = Vec::new();
    for (protocol, message) in protocols() {
        let pulse = |travel: f64| 1500.0 + half(protocol) * travel;
        for thrust_ends in [[-1.0, 1.0], [-0.9, 0.8], [-1.1, 1.15]] {
            for thrust in thrusts(thrust_ends.map(pulse)) {
                for rate_ends in [[-1.0, 1.0], [-1.0, 0.9]] {
                    for (reversed, order) in [("", "AETR"), ("T", "TAER"), ("AER", "AETR"), ("ERT", "RTEA")] {
                        for signs in [[1.0, -1.0, 1.0], [-1.0, -1.0, -1.0]] {
                            let [low, high] = rate_ends.map(pulse);
                            let vehicle = Vehicle {
                                thrust,
                                rates: [[f64::midpoint(low, high), high]; 3],
                                rate: [0, 1, 2].map(|axis| signs[axis] * RATES[axis]),
                            };
                            let transmitter = Transmitter {
                                device: Some("/dev/ttyUSB0".to_owned()),
                                order: order.to_owned(),
                                reversed: reversed.to_owned(),
                                thrust_ends,
                                rate_ends,
                                mavlink: (protocol == RadioProtocol::Mavlink).then_some(Mavlink {
                                    message,
                                    ..Mavlink::default()
                                }),
                                ..Transmitter::default()
                            };
                            found.push(described(vehicle, protocol, transmitter));
                        }
                    }
                }
            }
        }
    }
    found
}

/// The calibration of a vehicle behind a transmitter's channels: value = offset + slope · stick, whose stick is −1 at one
/// end of the channel and 1 at the other.
fn described(vehicle: Vehicle, protocol: RadioProtocol, transmitter: Transmitter) -> Case {
    let pulse = |travel: f64| 1500.0 + half(protocol) * travel;
    let sense = |letter: char| {
        if transmitter.reversed.contains(letter) {
            -1.0
        } else {
            1.0
        }
    };
    let [low, high] = transmitter.thrust_ends.map(pulse);
    let [none, full] = vehicle.thrust;
    let idle_share = (1.0 - (full - none).abs() / (high - low)).max(0.0);
    let has_channels = transmitter.has_channels(protocol);
    let (thrust_offset, thrust_slope) = if has_channels {
        let per_pulse = LARGEST / (full - none);
        (
            per_pulse * (f64::midpoint(low, high) - none),
            per_pulse * sense('T') * (high - low) / 2.0,
        )
    } else {
        // The stick goes from a share of 0 to 1, or back.
        let half = LARGEST / (1.0 - idle_share) / 2.0;
        (LARGEST - half, half * (full - none).signum())
    };
    let rate_slope = [0, 1, 2].map(|axis| vehicle.rate[axis] * sense(['A', 'E', 'R'][axis]));
    let resolution = 11;
    let stick = 2.0 / f64::from((1 << resolution) - 1);
    let link = RcLink {
        thrust_offset,
        thrust_slope,
        rate_slope,
        resolution,
        link: protocol,
        transmitter: Some(transmitter),
        ..RcLink::default()
    };
    let tolerance = if has_channels {
        let [none_rate, most] = vehicle.rates[0];
        [
            2.0 * LARGEST / (full - none).abs() + stick * thrust_slope.abs(),
            RATES[0] * (2.0 / (most - none_rate) + stick),
        ]
    } else {
        [stick * thrust_slope.abs() + 1e-5, RATES[0] * stick + 1e-5]
    };
    Case {
        vehicle,
        idle_share,
        link,
        tolerance,
    }
}

/// Commands from the controller to the transmitter: none and all of the thrust and between, every rate in both senses, and
/// every way to stop the motors.
pub fn asked(case: &Case) -> Vec<Asked> {
    let link = Link::new(Some(&case.link));
    let mut rest = ThrustRest::new(&case.link);
    let mut frame = RcFrame::new_zeroed();
    let mut found = vec![(Sticks::MOTORS_OFF, None)];
    link.transmit(None, None, &mut frame);
    found.push((rest.sticks(&frame), None));
    let torque = ControlCommand {
        thrust: 1.0,
        mode: ControlCommand::MODE_TORQUE,
        ..ControlCommand::new_zeroed()
    };
    link.transmit(Some(&torque), None, &mut frame);
    found.push((rest.sticks(&frame), None));
    let thrusts = [0.0, 0.3, 0.7, 1.0].map(|share| [share * LARGEST, 0.0, 0.0, 0.0]);
    let rates = [1, 2, 3].into_iter().flat_map(|stick| {
        [-1.0, -0.4, 0.6, 1.0].map(|share: f64| {
            let mut asked = [LARGEST / 2.0, 0.0, 0.0, 0.0];
            asked[stick] = share * RATES[stick - 1];
            asked
        })
    });
    for asked in thrusts.into_iter().chain(rates) {
        let [thrust, rates_body @ ..] = asked;
        let command = ControlCommand {
            thrust,
            rates_body,
            mode: ControlCommand::MODE_RATES,
            ..ControlCommand::new_zeroed()
        };
        link.transmit(Some(&command), None, &mut frame);
        found.push((rest.sticks(&frame), Some(asked)));
    }
    found
}
