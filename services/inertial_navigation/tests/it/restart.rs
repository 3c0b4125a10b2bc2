//! A restored filter continues bit by bit.

use inertial_navigation::{InertialFilter, InertialState};
use shared_types::gnss::FixKind;
use zerocopy::IntoBytes;

use super::rig::{Event, Flight, H_NS, give};

#[test]
fn a_filter_restored_at_any_time_continues_bit_by_bit() {
    restored(Flight::with_all_errors(4, FixKind::RtkFloat).seen());
    restored(Flight::with_all_errors(4, FixKind::RtkFixed).with_two_antennas());
}

fn restored(mut flight: Flight) {
    flight.duration = 30.0;
    let parameters = flight.parameters();
    let mut filter = InertialFilter::new(&parameters);
    let mut restored = filter.clone();
    let mut tick = 0;
    for (number, event) in flight.flown().1.into_iter().enumerate() {
        tick += u64::from(matches!(event, Event::Imu(_)));
        // Often within the alignment, on the ground and in the air, and in any state of queue and ring.
        if number % 37 == 0 {
            let saved: InertialState = restored.save();
            restored = InertialFilter::new(&parameters);
            restored.restore(&saved);
        }
        for filter in [&mut filter, &mut restored] {
            give(filter, &event, tick * H_NS);
        }
        if number % 101 == 0 {
            assert_eq!(filter.motion(), restored.motion());
            assert_eq!(
                filter.save().as_bytes(),
                restored.save().as_bytes(),
                "at {number}"
            );
        }
    }
    assert!(filter.is_aligned());
}
