//! Places on the earth: geodetic coordinates (WGS-84), earth-centred ones, and the local frame of a flight.
//!
//! ```text
//! N = a/√(1 − e² sin² φ)
//! x = (N + h) cos φ cos λ        y = (N + h) cos φ sin λ        z = (N (1 − e²) + h) sin φ
//! ```
//!
//! φ geodetic latitude, λ longitude, h height above the ellipsoid, m; a and e its larger semi-axis and eccentricity (NGA
//! Standard 0036, 2014). {N} has its axes to the north, to the east and downwards at the datum; {I} is {N} turned about the
//! vertical, so that its x axis has a stated azimuth. The transformations are exact: {I} stays a Cartesian frame at any
//! distance from the datum, and does not follow the curvature of the earth.

use nalgebra::{Matrix3, Vector3};

/// a, larger semi-axis of the ellipsoid, m.
const SEMI_MAJOR: f64 = 6_378_137.0;
/// Flattening of the ellipsoid.
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// e².
const ECCENTRICITY_SQUARED: f64 = FLATTENING * (2.0 - FLATTENING);

/// Largest number of iterations for a latitude. Near the surface each divides the error by about 300.
const MOST_ITERATIONS: u32 = 12;

/// Geodetic place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geodetic {
    /// φ, degrees.
    pub latitude: f64,
    /// λ, degrees.
    pub longitude: f64,
    /// h, m.
    pub height: f64,
}

impl Geodetic {
    /// Returns the earth-centred, earth-fixed coordinates, m.
    #[must_use]
    pub fn to_ecef(self) -> Vector3<f64> {
        let (latitude, longitude) = (self.latitude.to_radians(), self.longitude.to_radians());
        let (sine, cosine) = (libm::sin(latitude), libm::cos(latitude));
        let n = normal_radius(sine);
        let across = (n + self.height) * cosine;
        Vector3::new(
            across * libm::cos(longitude),
            across * libm::sin(longitude),
            (n * (1.0 - ECCENTRICITY_SQUARED) + self.height) * sine,
        )
    }

    /// Returns the place of earth-centred, earth-fixed coordinates, m: by iteration of the latitude, until it stays the same.
    #[must_use]
    pub fn from_ecef(ecef: &Vector3<f64>) -> Self {
        let across = libm::hypot(ecef.x, ecef.y);
        // φ = atan2(z + e² N sin φ, √(x² + y²)), from its value on the surface.
        let mut latitude = libm::atan2(ecef.z, across * (1.0 - ECCENTRICITY_SQUARED));
        for _ in 0..MOST_ITERATIONS {
            let sine = libm::sin(latitude);
            let next = libm::atan2(ecef.z + ECCENTRICITY_SQUARED * normal_radius(sine) * sine, across);
            let is_same = next == latitude;
            latitude = next;
            if is_same {
                break;
            }
        }
        let (sine, cosine) = (libm::sin(latitude), libm::cos(latitude));
        // h = √(x² + y²) cos φ + z sin φ − a √(1 − e² sin² φ), which is accurate at the poles too.
        let height =
            across * cosine + ecef.z * sine - SEMI_MAJOR * (1.0 - ECCENTRICITY_SQUARED * sine * sine).sqrt();
        Self {
            latitude: latitude.to_degrees(),
            longitude: libm::atan2(ecef.y, ecef.x).to_degrees(),
            height,
        }
    }
}

/// Returns N for sin φ, m.
fn normal_radius(sine: f64) -> f64 {
    SEMI_MAJOR / (1.0 - ECCENTRICITY_SQUARED * sine * sine).sqrt()
}

/// Local frame {I} of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalFrame {
    origin_ecef: Vector3<f64>,
    /// {N} from earth-centred axes: its rows are north, east and down.
    ned_from_ecef: Matrix3<f64>,
    /// {I} from {N}.
    world_from_ned: Matrix3<f64>,
}

impl LocalFrame {
    /// Makes the frame whose origin is `datum`, and whose x axis has an azimuth, clockwise from north, rad.
    #[must_use]
    pub fn new(datum: Geodetic, azimuth: f64) -> Self {
        let (latitude, longitude) = (datum.latitude.to_radians(), datum.longitude.to_radians());
        let (sin_phi, cos_phi) = (libm::sin(latitude), libm::cos(latitude));
        let (sin_lambda, cos_lambda) = (libm::sin(longitude), libm::cos(longitude));
        let (sine, cosine) = (libm::sin(azimuth), libm::cos(azimuth));
        Self {
            origin_ecef: datum.to_ecef(),
            ned_from_ecef: Matrix3::new(
                -sin_phi * cos_lambda,
                -sin_phi * sin_lambda,
                cos_phi,
                -sin_lambda,
                cos_lambda,
                0.0,
                -cos_phi * cos_lambda,
                -cos_phi * sin_lambda,
                -sin_phi,
            ),
            world_from_ned: Matrix3::new(cosine, sine, 0.0, -sine, cosine, 0.0, 0.0, 0.0, 1.0),
        }
    }

    /// Returns a place in {I}, m.
    #[must_use]
    pub fn to_world(&self, place: Geodetic) -> Vector3<f64> {
        self.world_from_ned * (self.ned_from_ecef * (place.to_ecef() - self.origin_ecef))
    }

    /// Returns the geodetic place of a position in {I}, m.
    #[must_use]
    pub fn to_geodetic(&self, position_world: &Vector3<f64>) -> Geodetic {
        let ned = self.world_from_ned.tr_mul(position_world);
        Geodetic::from_ecef(&(self.origin_ecef + self.ned_from_ecef.tr_mul(&ned)))
    }

    /// Returns a vector to the north, to the east and downwards at the datum in {I}.
    #[must_use]
    pub fn turned(&self, ned: [f64; 3]) -> [f64; 3] {
        (self.world_from_ned * Vector3::from(ned)).into()
    }

    /// Returns {I} from {N}, the axes to the north, to the east and downwards at the datum.
    #[must_use]
    pub fn world_from_ned(&self) -> &Matrix3<f64> {
        &self.world_from_ned
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn place(latitude: f64, longitude: f64, height: f64) -> Geodetic {
        Geodetic {
            latitude,
            longitude,
            height,
        }
    }
    #[test]
    fn earth_centred_coordinates_are_those_of_proj() {
        // pyproj 3.7.2, EPSG:4979 to EPSG:4978.
        for (latitude, longitude, height, expected) in [
            (
                48.137154,
                11.576124,
                565.0,
                [
                    4_177_999.959_692_189_5,
                    855_805.985_897_199_5,
                    4_727_488.032_552_699,
                ],
            ),
            (
                -33.856784,
                151.215297,
                20.0,
                [
                    -4_646_983.926_650_636,
                    2_553_085.636_980_386,
                    -3_533_276.796_085_521_6,
                ],
            ),
            (
                89.5,
                -120.0,
                -30.0,
                [
                    -27_923.002_411_661_96,
                    -48_364.058_876_866_83,
                    6_356_478.638_565_467,
                ],
            ),
            (0.0, 0.0, 0.0, [6_378_137.0, 0.0, 0.0]),
            (-90.0, 0.0, 100.0, [0.0, 0.0, -6_356_852.314_245_179]),
            (
                27.988056,
                86.925278,
                8848.86,
                [
                    302_742.711_090_218_8,
                    5_636_029.982_608_099,
                    2_979_489.179_165_373_6,
                ],
            ),
        ] {
            let place = place(latitude, longitude, height);
            let difference = place.to_ecef() - Vector3::from(expected);
            assert!(difference.norm() < 3e-9, "{place:?}: {difference}");
        }
    }

    #[test]
    fn local_coordinates_are_those_of_pymap3d() {
        // pymap3d 3.2.0, geodetic2ned.
        let frame = LocalFrame::new(place(48.137154, 11.576124, 565.0), 0.0);
        for (latitude, longitude, height, expected) in [
            (
                48.137654,
                11.576924,
                566.5,
                [
                    55.601_750_634_318_24,
                    59.546_571_007_972_97,
                    -1.499_479_966_931_08,
                ],
            ),
            (
                48.146154,
                11.566124,
                600.0,
                [
                    1_000.880_307_666_293_2,
                    -744.213_163_258_780_6,
                    -34.878_053_891_301_65,
                ],
            ),
            (
                48.13,
                11.58,
                500.0,
                [
                    -795.529_312_107_981_1,
                    288.543_013_260_234_03,
                    65.056_178_890_760_18,
                ],
            ),
        ] {
            let difference = frame.to_world(place(latitude, longitude, height)) - Vector3::from(expected);
            assert!(difference.norm() < 3e-9, "{latitude}: {difference}");
        }
    }

    #[test]
    fn the_x_axis_has_the_azimuth() {
        let datum = place(48.0, 11.0, 500.0);
        let frame = LocalFrame::new(datum, std::f64::consts::FRAC_PI_2);
        let east = frame.to_geodetic(&Vector3::new(10.0, 0.0, 0.0));
        assert!(east.longitude > datum.longitude + 1e-4 && (east.latitude - datum.latitude).abs() < 1e-9);
        let north = frame.to_geodetic(&Vector3::new(0.0, -10.0, 0.0));
        assert!(north.latitude > datum.latitude + 8e-5 && (north.longitude - datum.longitude).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn a_position_comes_back_from_its_place(
            latitude in -90.0..90.0f64, longitude in -180.0..180.0f64, height in -500.0..9000.0f64,
            azimuth in -4.0..4.0f64, position in proptest::array::uniform3(-10_000.0..10_000.0f64),
        ) {
            let frame = LocalFrame::new(place(latitude, longitude, height), azimuth);
            let position = Vector3::from(position);
            let back = frame.to_world(frame.to_geodetic(&position));
            prop_assert!((back - position).norm() < 2e-8, "{}", (back - position).norm());
        }
    }
}
