//! A sample allocates nothing.

use crate::allocations;
use sensor_models::barometer::Surroundings;
use sensor_models::{
    Barometer, BarometerParameters, Gnss, GnssParameters, Imu, ImuParameters, Magnetometer,
    MagnetometerParameters, TrueMotion,
};
use shared_types::gnss::FixKind;

#[test]
fn samples_do_not_allocate() {
    let motion = TrueMotion::AT_REST;
    let around = Surroundings {
        altitude: 1.0,
        above_ground: 0.1,
        airspeed: 3.0,
        rotors_turn: true,
    };
    let mut imu = Imu::new(&ImuParameters::default(), 1, 1e-3);
    let mut gnss = Gnss::new(&GnssParameters::default(), 1, 0.1);
    let mut barometer = Barometer::new(&BarometerParameters::default(), 1, 0.04);
    let mut magnetometer = Magnetometer::new(&MagnetometerParameters::default(), 1);
    let count = allocations::allocations_during(|| {
        for tick in 0..100 {
            imu.sample(tick, &motion, 200.0);
            gnss.sample(tick, &motion, FixKind::RtkFixed);
            barometer.sample(tick, &around);
            magnetometer.sample(tick, &motion.world_from_body, 0.4);
            imu.restore(&imu.save());
            gnss.restore(&gnss.save());
            barometer.restore(&barometer.save());
        }
    });
    assert_eq!(count, 0);
}
