//! Allan deviation of a unit at rest; `tests/interop/allan.sh` asks allantools for it.

use sensor_models::{Imu, ImuParameters, TrueMotion};

/// Period of the samples, s.
const PERIOD: f64 = 0.01;
const COUNT: usize = 500_000;

/// Returns the integral of each signal of a unit at rest: three rates, then three specific forces.
fn integrals(seed: u64) -> [Vec<f64>; 6] {
    let parameters = ImuParameters {
        vibration: [0.0; 2],
        ..ImuParameters::default()
    };
    let mut imu = Imu::new(&parameters, seed, PERIOD);
    let mut integrals = [const { Vec::new() }; 6];
    let mut sums = [0.0; 6];
    for tick in 0..COUNT {
        let sample = imu.sample(tick as u64, &TrueMotion::AT_REST, 0.0);
        let signals = sample
            .angular_velocity_body
            .iter()
            .chain(&sample.specific_force_body);
        for ((integral, sum), signal) in integrals.iter_mut().zip(&mut sums).zip(signals) {
            *sum += signal * PERIOD;
            integral.push(*sum);
        }
    }
    integrals
}

/// Returns the overlapping Allan deviation over `span` samples, from the integral of a signal (IEEE Std 952-1997, C.1).
fn allan_deviation(integral: &[f64], span: usize) -> f64 {
    let differences = integral
        .windows(2 * span + 1)
        .map(|window| window[2 * span] - 2.0 * window[span] + window[0]);
    let count = (integral.len() - 2 * span) as f64;
    let tau = span as f64 * PERIOD;
    (differences.map(|difference| difference * difference).sum::<f64>() / (2.0 * count)).sqrt() / tau
}

#[test]
fn the_allan_deviation_is_that_of_the_stated_noise_and_bias_walk() {
    let parameters = ImuParameters::default();
    let integrals = integrals(3);
    for (triad, signals) in [
        (parameters.gyroscope, &integrals[..3]),
        (parameters.accelerometer, &integrals[3..]),
    ] {
        // The deviation of the three axes together; three times its own error is allowed, with as many independent spans.
        for span in [10, 100, 1_000, 10_000] {
            let tau = span as f64 * PERIOD;
            let (n, k) = (triad.noise_density, triad.bias_walk);
            let resolution = triad.resolution * triad.resolution / 12.0 * PERIOD;
            let stated = ((n * n + resolution) / tau + k * k * tau / 3.0).sqrt();
            let squares = signals
                .iter()
                .map(|signal| allan_deviation(signal, span))
                .map(|deviation| deviation * deviation);
            let measured = (squares.sum::<f64>() / 3.0).sqrt();
            let tolerance = 3.0 / (2.0 * 3.0 * COUNT as f64 / span as f64).sqrt();
            assert!(
                (measured / stated - 1.0).abs() < tolerance,
                "{tau} s: {measured} instead of {stated}, more than {tolerance}"
            );
        }
    }
}
