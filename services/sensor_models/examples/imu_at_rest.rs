//! Samples of an inertial measurement unit at rest, for programs that judge its noise.
//!
//!     imu_at_rest SECONDS RATE SEED
//!
//! Writes three rates (rad/s) and three specific forces (m/s²) a sample, as little-endian numbers of 8 bytes, to its
//! standard output; and the stated noise, as a line of JSON, to its standard error.

use std::io::Write;

use sensor_models::{Imu, ImuParameters, TrueMotion};

fn main() -> std::io::Result<()> {
    let numbers: Vec<f64> = std::env::args()
        .skip(1)
        .map(|word| word.parse().expect("a number"))
        .collect();
    let &[duration, rate, seed] = numbers.as_slice() else {
        panic!("usage: imu_at_rest SECONDS RATE SEED");
    };
    let parameters = ImuParameters {
        vibration: [0.0; 2],
        ..ImuParameters::default()
    };
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "numbers of samples"
    )]
    let (count, seed) = ((duration * rate) as u64, seed as u64);
    let mut imu = Imu::new(&parameters, seed, 1.0 / rate);
    let mut output = std::io::BufWriter::new(std::io::stdout().lock());
    for tick in 0..count {
        let sample = imu.sample(tick, &TrueMotion::AT_REST, 0.0);
        for number in sample
            .angular_velocity_body
            .iter()
            .chain(&sample.specific_force_body)
        {
            output.write_all(&number.to_le_bytes())?;
        }
    }
    output.flush()?;
    for (name, triad) in [
        ("gyroscope", parameters.gyroscope),
        ("accelerometer", parameters.accelerometer),
    ] {
        let (n, k, step) = (triad.noise_density, triad.bias_walk, triad.resolution);
        eprintln!(
            r#"{{"sensor": "{name}", "noise_density": {n:e}, "bias_walk": {k:e}, "resolution": {step:e}}}"#
        );
    }
    Ok(())
}
