//! Vehicle on frames that cannot have been sent.

use plant::PlantService;
use proptest::prelude::*;
use shared_types::Now;
use shared_types::sample::Field;
use shared_types::samples::{MocapPose, RcFrame, VehicleTruth};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use zerocopy::{FromBytes, FromZeros, IntoBytes};

const TICK_NS: u64 = 1_000_000;
const IDEAL: &str = "";
const RATE_LOOP: &str =
    "[vehicle.actuators]\ninitial_thrust = 1.962\n[controller.rates]\n[model]\n[estimator.kalman]\n[cameras]";

fn service(sections: &str) -> PlantService {
    let head = "duration = 1.0\n\
                vehicle.mass = 0.2\nvehicle.inertia = [6.5e-4, 6.5e-4, 13.0e-4]\n\
                path.curve.hover.position = [0.0, 0.0, -1.0]\n";
    PlantService::new(&toml::from_str(&(head.to_owned() + sections)).unwrap())
}

fn frame(tick: u64, mode: u32) -> RcFrame {
    let mut frame = RcFrame::new_zeroed();
    (frame.header.seq, frame.header.stamp_ns) = (tick, tick * TICK_NS);
    (frame.thrust, frame.mode) = (1.5, mode);
    (frame.torque_body, frame.rates_body) = ([1e-4, 0.0, 0.0], [0.3, 0.0, -0.2]);
    frame
}

fn step(service: &mut PlantService, tick: u64, frame: &RcFrame) -> (VehicleTruth, MocapPose) {
    let now = Now {
        tick,
        time_ns: tick * TICK_NS,
        elapsed_ns: if tick == 0 { 0 } else { TICK_NS },
        operator: shared_types::Operator::FLYING,
    };
    let inputs = [InputView {
        bytes: Some(frame.as_bytes()),
        fresh: true,
    }];
    let (mut truth, mut pose) = (VehicleTruth::new_zeroed(), MocapPose::new_zeroed());
    let bytes = [
        Some(truth.as_mut_bytes()),
        Some(pose.as_mut_bytes()),
        None,
        None,
        None,
        None,
        None,
    ];
    let mut outputs = bytes.map(|bytes| OutputSlot { bytes });
    ErasedService::step(service, &now, &inputs, &mut outputs);
    (truth, pose)
}

fn restarted(service: &PlantService, sections: &str) -> PlantService {
    crate::restart::restarted(service, self::service(sections))
}

#[test]
fn a_frame_that_is_not_finite_or_of_an_unknown_mode_is_not_received_and_the_one_before_goes_on_acting() {
    for (sections, mode) in [(IDEAL, RcFrame::MODE_TORQUE), (RATE_LOOP, RcFrame::MODE_RATES)] {
        let (mut disturbed, mut undisturbed) = (service(sections), service(sections));
        for tick in 0..300 {
            let before = frame(tick - tick % 7, mode);
            let mut received = before;
            // The first step only publishes the initial state.
            if tick > 7 && tick % 7 != 0 {
                received.header.seq = tick;
                received.channels = [9; 16];
                match tick % 4 {
                    3 => received.mode = 77,
                    kind => received.thrust = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][kind as usize],
                }
            }
            disturbed = restarted(&disturbed, sections);
            let (truth, _) = step(&mut disturbed, tick, &received);
            assert_eq!(
                truth.as_bytes(),
                step(&mut undisturbed, tick, &before).0.as_bytes(),
                "{tick}"
            );
        }
    }
}

proptest! {
    /// With a rate loop, whose limits bound every command.
    #[test]
    fn any_input_bits_keep_a_vehicle_with_a_rate_loop_finite(
        frames in proptest::collection::vec(
            (proptest::collection::vec(any::<u8>(), size_of::<RcFrame>()), any::<bool>()), 1..40),
    ) {
        let mut service = service(RATE_LOOP);
        for (tick, (bytes, sends_rates)) in (0..).zip(&frames) {
            let mut frame = RcFrame::read_from_bytes(bytes).unwrap();
            if *sends_rates {
                frame.mode = RcFrame::MODE_RATES;
            }
            let (truth, pose) = step(&mut service, tick, &frame);
            prop_assert!(truth.is_finite() && pose.is_finite(), "{:?}", truth);
        }
    }
}
