//! EKF2 behind the events of the rig.

use ekf2::types::{BaroSample, ExtVisionSample, GnssSample, ImuSample, MagSample};
use ekf2::{Ekf, EkfConfig, ExternalVisionControl, HeightReference};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use crate::rig::{Event, H_NS, POSE_LATE};

/// Radius of the sphere on which PX4 projects, m.
const RADIUS: f64 = 6_371_000.0;
/// Datum of the simulated flights: latitude, longitude (°) and height (m).
pub const DATUM: [f64; 3] = [47.4, 8.5, 488.0];

/// Noises with which EKF2 flies. PX4's defaults are 0.5 m, 0.3 m/s, 0.015 rad/s, 0.35 m/s² and 0.05 G.
#[derive(Clone, Copy, Debug)]
pub struct Noises {
    pub position: f32,
    pub velocity: f32,
    pub gyroscope: f32,
    pub accelerometer: f32,
    pub field: f32,
    /// The height comes from fixes, and not from the barometer.
    pub height_of_fixes: bool,
    /// Of the position of a pose, m, of which EKF2 takes 0.01 m at least; `None` without cameras. With them fixes and barometer are
    /// switched off.
    pub pose: Option<f32>,
}

impl Noises {
    pub const DEFAULT: Self = Self {
        position: 0.5,
        velocity: 0.3,
        gyroscope: 0.015,
        accelerometer: 0.35,
        field: 0.05,
        height_of_fixes: false,
        pose: None,
    };
}

/// EKF2 on a flight.
pub struct Reference(Ekf<'static>);

impl Reference {
    /// Starts EKF2 for fixes that are `latency` s late.
    pub fn new(noises: Noises, latency: f64) -> Self {
        // The default of 110 ms is for samples every 10 ms; at 250 Hz its buffer of 11 of them is too short for these fixes,
        // which would then be fused up to 40 ms after their time.
        let config = EkfConfig {
            delay_max_ms: 200.0,
            ..EkfConfig::default()
        };
        let mut ekf = Ekf::with_config(config).expect("EKF2 starts");
        let mut params = ekf.params_mut();
        params.set_gps_pos_noise(noises.position);
        params.set_gps_vel_noise(noises.velocity);
        params.set_gyro_noise(noises.gyroscope);
        params.set_accel_noise(noises.accelerometer);
        params.set_mag_noise(noises.field);
        params.set_gps_delay_ms((latency * 1e3) as f32);
        params.set_mag_delay_ms(0.0);
        params.set_baro_delay_ms(0.0);
        if noises.height_of_fixes {
            params.set_hgt_ref(HeightReference::Gnss);
            params.set_gps_ctrl(7);
            params.set_baro_ctrl(0);
        }
        if let Some(deviation) = noises.pose {
            params.set_ev_ctrl(
                ExternalVisionControl::HPOS | ExternalVisionControl::VPOS | ExternalVisionControl::YAW,
            );
            params.set_hgt_ref(HeightReference::ExternalVision);
            params.set_ev_pos_noise(deviation);
            params.set_ev_att_noise(2e-3);
            params.set_ev_delay_ms((POSE_LATE * H_NS) as f32 * 1e-6);
            params.set_gps_ctrl(0);
            params.set_baro_ctrl(0);
        }
        ekf.set_in_air_status(false);
        ekf.set_vehicle_at_rest(true);
        let [latitude, longitude, height] = DATUM;
        let _ = ekf.set_global_origin(latitude, longitude, height as f32, 1.0, 1.0);
        Self(ekf)
    }

    pub fn give(&mut self, event: &Event, tick: u64) {
        let ekf = &mut self.0;
        let single =
            |vector: &Vector3<f64>| -> [f32; 3] { [vector.x as f32, vector.y as f32, vector.z as f32] };
        match event {
            Event::Imu(sample) => {
                let h = H_NS as f64 * 1e-9;
                ekf.set_imu_data(&ImuSample::new(
                    sample.time_ns / 1000,
                    single(&(sample.rate_body * h)),
                    single(&(sample.force_body * h)),
                    h as f32,
                    h as f32,
                ));
                ekf.update();
            }
            Event::Field(field) => {
                ekf.set_mag_data(&MagSample::new(field.time_ns / 1000, single(&field.field_body)))
            }
            Event::Altitude(altitude) => {
                let height = altitude.altitude + DATUM[2];
                ekf.set_baro_data(&BaroSample::new(altitude.time_ns / 1000, height as f32));
            }
            Event::Fix(fix) => {
                let [latitude, longitude, height] = DATUM;
                let north = (fix.position_world.x / RADIUS).to_degrees();
                let east = (fix.position_world.y / (RADIUS * latitude.to_radians().cos())).to_degrees();
                let [horizontal, vertical, speed] = fix.accuracies.map(|accuracy| accuracy as f32);
                // EKF2 subtracts the delay from the time of arrival.
                ekf.set_gps_data(&GnssSample::new(
                    tick * H_NS / 1000,
                    latitude + north,
                    longitude + east,
                    (height - fix.position_world.z) as f32,
                    single(&fix.velocity_world),
                    horizontal,
                    vertical,
                    speed,
                    1.0,
                    6,
                    16,
                ));
            }
            Event::Pose(pose) => {
                let (Some(place), Some(attitude)) = (&pose.position_world, &pose.world_from_body) else {
                    return;
                };
                let turn = UnitQuaternion::from_matrix(attitude);
                ekf.set_ev_data(&ExtVisionSample {
                    time_us: tick * H_NS / 1000,
                    pos: single(place),
                    quat: [turn.w, turn.i, turn.j, turn.k].map(|number| number as f32),
                    vel: [f32::NAN; 3],
                    pos_var: [9e-8; 3],
                    ang_var: [4e-6; 3],
                    vel_var: [f32::NAN; 3],
                    pos_frame: 0,
                    vel_frame: 0,
                    reset_counter: 0,
                    quality: 100,
                });
            }
            // EKF2 takes a heading, no baseline; none of the flights has one.
            Event::Baseline(_) => {}
            Event::Motors => {
                ekf.set_in_air_status(true);
                ekf.set_vehicle_at_rest(false);
            }
        }
    }

    /// Returns position, velocity and attitude.
    pub fn motion(&self) -> (Vector3<f64>, Vector3<f64>, Matrix3<f64>) {
        let double = |numbers: [f32; 3]| Vector3::from(numbers.map(f64::from));
        let [w, x, y, z] = self.0.quaternion().map(f64::from);
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix();
        (
            double(self.0.position_ned()),
            double(self.0.velocity_ned()),
            *rotation.matrix(),
        )
    }
}
