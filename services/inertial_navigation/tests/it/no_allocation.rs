//! The filter allocates nothing.

use inertial_navigation::InertialFilter;
use shared_types::gnss::FixKind;

use super::rig::{Event, Flight, H_NS, give};
use crate::allocations;

#[test]
fn steps_do_not_allocate() {
    let mut flight = Flight::with_all_errors(4, FixKind::RtkFixed);
    flight.duration = 25.0;
    let events = flight.flown().1;
    let mut filter = InertialFilter::new(&flight.parameters());
    let mut tick = 0;
    let count = allocations::allocations_during(|| {
        for event in &events {
            tick += u64::from(matches!(event, Event::Imu(_)));
            give(&mut filter, event, tick * H_NS);
            if tick % 100 == 0 {
                filter.restore(&filter.save());
            }
        }
    });
    assert!(filter.is_aligned());
    assert_eq!(count, 0);
}
