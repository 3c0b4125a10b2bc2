//! Fixes of satellite receivers: what was solved, and the errors that follow from it.

/// What a receiver has solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum FixKind {
    /// From the codes of the satellites alone.
    SinglePoint = 0,
    /// With corrections, and with the numbers of carrier waves as real numbers.
    RtkFloat = 1,
    /// With corrections, and with these numbers known.
    RtkFixed = 2,
}

impl FixKind {
    /// All kinds, the least accurate first.
    pub const ALL: [Self; 3] = [Self::SinglePoint, Self::RtkFloat, Self::RtkFixed];
}

/// Errors of a kind of fixes, each one standard deviation of a component: a white part, and a slow one, which is a first-order
/// Gauss–Markov process.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FixErrors {
    /// White error of a horizontal position, m.
    pub position_white: f64,
    /// Slow error of a horizontal position, m.
    pub position_slow: f64,
    /// Correlation time of the slow error of the position, s.
    pub position_time: f64,
    /// Vertical error of the position over the horizontal one.
    pub vertical_factor: f64,
    /// White error of the velocity, m/s.
    pub velocity_white: f64,
    /// Slow error of the velocity, m/s.
    pub velocity_slow: f64,
    /// Correlation time of the slow error of the velocity, s.
    pub velocity_time: f64,
}

impl FixErrors {
    /// Typical errors of each kind: RTK of a short baseline, and a single-point receiver for several systems.
    pub const TYPICAL: [Self; 3] = {
        let rtk = Self {
            position_white: 0.008,
            position_slow: 0.006,
            position_time: 30.0,
            vertical_factor: 1.5,
            velocity_white: 0.05,
            velocity_slow: 0.02,
            velocity_time: 2.0,
        };
        [
            Self {
                position_white: 0.15,
                position_slow: 1.0,
                position_time: 120.0,
                velocity_white: 0.08,
                velocity_slow: 0.05,
                ..rtk
            },
            Self {
                position_white: 0.03,
                position_slow: 0.2,
                position_time: 60.0,
                ..rtk
            },
            rtk,
        ]
    };

    /// Returns the standard deviations of the whole error of a fix: of a horizontal component of the position (m), of the
    /// height (m), and of a component of the velocity (m/s).
    #[must_use]
    pub fn deviations(&self) -> [f64; 3] {
        let sum = |white: f64, slow: f64| (white * white + slow * slow).sqrt();
        let position = sum(self.position_white, self.position_slow);
        [
            position,
            position * self.vertical_factor,
            sum(self.velocity_white, self.velocity_slow),
        ]
    }
}
