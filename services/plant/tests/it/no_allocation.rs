//! A step of the plant allocates nothing.

use crate::allocations;
use plant::PlantService;
use shared_types::Now;
use shared_types::samples::{
    BaroAltitude, GnssBaseline, GnssFix, ImuSample, MagField, MocapPose, RcFrame, VehicleTruth,
};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use zerocopy::{FromZeros, IntoBytes};

#[test]
fn a_step_of_the_plant_does_not_allocate() {
    assert_no_allocation("");
}

#[test]
fn a_step_with_sensors_does_not_allocate() {
    assert_no_allocation("\nsensors.gnss.baseline = [1.0, 0.0, 0.0]");
}

fn assert_no_allocation(sections: &str) {
    let text = format!(
        "duration = 1.0\n\
         vehicle = {{ mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4], change = [{{ at = 0.05, mass = 0.245 }}] }}\n\
         path.curve.hover.position = [0.0, 0.0, -1.0]{sections}",
    );
    let scenario = toml::from_str(&text);
    let mut service = PlantService::new(&scenario.unwrap());
    let frame = RcFrame::new_zeroed();
    let mut truth = VehicleTruth::new_zeroed();
    let mut pose = MocapPose::new_zeroed();
    let mut imu = ImuSample::new_zeroed();
    let mut fix = GnssFix::new_zeroed();
    let mut altitude = BaroAltitude::new_zeroed();
    let mut field = MagField::new_zeroed();
    let mut baseline = GnssBaseline::new_zeroed();
    let mut state = vec![0; service.state_size()];
    let count = allocations::allocations_during(|| {
        for tick in 0..100 {
            let now = Now {
                tick,
                time_ns: tick * 1_000_000,
                elapsed_ns: tick.min(1) * 1_000_000,
                operator: shared_types::Operator::FLYING,
            };
            let inputs = [InputView {
                bytes: Some(frame.as_bytes()),
                fresh: true,
            }];
            let bytes = [
                Some(truth.as_mut_bytes()),
                Some(pose.as_mut_bytes()),
                Some(imu.as_mut_bytes()),
                Some(fix.as_mut_bytes()),
                Some(altitude.as_mut_bytes()),
                Some(field.as_mut_bytes()),
                Some(baseline.as_mut_bytes()),
            ];
            let mut outputs = bytes.map(|bytes| OutputSlot { bytes });
            ErasedService::step(&mut service, &now, &inputs, &mut outputs);
            ErasedService::save(&service, &mut state);
            ErasedService::restore(&mut service, &state);
        }
    });
    assert_eq!(count, 0);
    assert_eq!(truth.mass, 0.245);
}
