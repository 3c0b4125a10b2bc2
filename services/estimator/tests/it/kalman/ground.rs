//! Vehicle that stands on the ground, leaves it and comes back.

use estimator::kalman::{KalmanFilter, Outcome};
use nalgebra::Vector3;
use scenario::{Flight, GRAVITY, Kalman, Model};
use shared_types::samples::{MocapPose, RcFrame};
use zerocopy::FromZeros;

use super::rig::{normal3, scenario};

const TICK_NS: u64 = 1_000_000;
const MASS: f64 = 0.2;
const WEIGHT: f64 = MASS * GRAVITY;

/// Vehicle that moves straight up and down, level, with its filter: captures every 10 ms without latency, frames every
/// 20 ms that act at once.
struct Lift {
    filter: KalmanFilter,
    mass: f64,
    height: f64,
    speed: f64,
    thrust: f64,
    tick: u64,
    /// The height that cameras show, if it is frozen, m.
    frozen: Option<f64>,
}

impl Lift {
    fn new(mass: f64) -> Self {
        Self {
            filter: grounded(),
            mass,
            height: 0.0,
            speed: 0.0,
            thrust: 0.0,
            tick: 0,
            frozen: None,
        }
    }

    fn now_ns(&self) -> u64 {
        self.tick * TICK_NS
    }

    /// Flies so many ticks while frames command a thrust, N, or none at all.
    fn go_on(&mut self, ticks: u64, asked: Option<f64>, mut look: impl FnMut(&Self)) {
        for _ in 0..ticks {
            if self.tick.is_multiple_of(20) {
                self.filter.add_frame(self.now_ns(), &frame(self.now_ns(), asked));
            }
            if self.tick.is_multiple_of(10) {
                let mut seen = capture(self.now_ns(), self.height);
                if let Some(height) = self.frozen {
                    seen.position_world[2] = -height;
                }
                self.filter.add_capture(self.now_ns(), &seen);
                // As after a death.
                let mut restarted = grounded();
                restarted.restore(&self.filter.save());
                self.filter = restarted;
            }
            look(self);
            let h = 1e-3;
            self.thrust += (asked.unwrap_or(0.0) - self.thrust) * h / Model::default().thrust_lag;
            self.speed += (self.thrust / self.mass - GRAVITY) * h;
            self.height += self.speed * h;
            if self.height <= 0.0 {
                (self.height, self.speed) = (0.0, 0.0);
            }
            self.tick += 1;
        }
    }

    /// Returns estimated minus true speed of the climb, m/s, and height, m.
    fn errors(&self) -> [f64; 2] {
        let told = self.filter.estimate(self.now_ns()).unwrap();
        [
            -told.velocity_body[2] - self.speed,
            -told.position_world[2] - self.height,
        ]
    }
}

/// The filter of a flight from take-off to landing.
fn grounded() -> KalmanFilter {
    let model = Model {
        mass: MASS,
        radio_latency: 0.0,
        ..Model::default()
    };
    let mut scenario = scenario(&model, &Kalman::default());
    scenario.flight = Some(Flight::default());
    KalmanFilter::new(&scenario, &Kalman::default()).unwrap()
}

fn frame(stamp_ns: u64, asked: Option<f64>) -> RcFrame {
    let mut frame = RcFrame {
        thrust: asked.unwrap_or(0.0),
        failsafe: asked.is_none().into(),
        mode: RcFrame::MODE_RATES,
        ..RcFrame::new_zeroed()
    };
    frame.header.stamp_ns = stamp_ns;
    frame
}

fn capture(time_ns: u64, height: f64) -> MocapPose {
    let position = Vector3::new(0.0, 0.0, -height) + normal3(1, time_ns) * 3e-4;
    MocapPose {
        capture_time_ns: time_ns,
        position_world: position.into(),
        world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        tracked: true.into(),
        ..MocapPose::new_zeroed()
    }
}

#[test]
fn the_grounds_support_leaves_no_disturbance_after_the_lift_off() {
    // The vehicle may be lighter or heavier than modelled: the ground carries little meanwhile.
    for mass in [MASS, 0.8 * MASS, 1.3 * MASS] {
        let mut lift = Lift::new(mass);
        lift.go_on(5_000, None, |lift| assert!(lift.errors()[0].abs() < 1e-9));
        let mut largest = [0.0_f64; 2];
        lift.go_on(600, Some(1.1 * mass * GRAVITY), |lift| {
            for (largest, error) in largest.iter_mut().zip(lift.errors()) {
                *largest = largest.max(error.abs());
            }
        });
        assert!(lift.height > 0.05, "{mass} kg have left the ground");
        assert!(largest[0] < 0.1 && largest[1] < 0.002, "{mass} kg: {largest:?}");
    }
}

#[test]
fn a_vehicle_carried_about_on_the_ground_is_where_it_is_seen() {
    let mut filter = grounded();
    for number in 0..500_u64 {
        let now_ns = number * 10 * TICK_NS;
        filter.add_frame(now_ns, &frame(now_ns, None));
        let height = (number / 50 % 2) as f64 * 0.7;
        let seen = capture(now_ns, height);
        assert!(matches!(filter.add_capture(now_ns, &seen), Outcome::Started));
        let told = filter.estimate(now_ns).unwrap();
        assert_eq!(told.position_world, seen.position_world);
        assert_eq!(
            (told.velocity_body, told.acceleration_world),
            ([0.0; 3], [0.0; 3])
        );
    }
    assert_eq!(filter.captures_refused(), 0);
}

#[test]
fn a_vehicle_that_has_come_down_stands_once_its_motors_stop() {
    let mut lift = Lift::new(MASS);
    let stands = |lift: &Lift| lift.filter.state().unwrap().stands;
    lift.go_on(1_000, None, |lift| assert!(lift.tick == 0 || stands(lift)));
    lift.go_on(500, Some(1.2 * WEIGHT), |_| {});
    assert!(!stands(&lift) && lift.height > 0.1);
    // A fall with stopped motors does not count as standing.
    lift.go_on(100, None, |lift| assert!(!stands(lift)));
    lift.go_on(3_000, None, |_| {});
    assert!(stands(&lift) && lift.height == 0.0);
    lift.go_on(500, Some(1.2 * WEIGHT), |_| {});
    assert!(!stands(&lift) && lift.errors()[0].abs() < 0.1);
}

/// Free flight takes a vehicle that sinks away from a height that is frozen, as the ground would: it does not stand there.
#[test]
fn a_height_that_freezes_in_the_descent_is_no_ground() {
    let mut lift = Lift::new(MASS);
    lift.go_on(500, Some(1.2 * WEIGHT), |_| ());
    // Until it sinks at 0.3 m/s.
    while lift.speed > -0.3 {
        lift.go_on(20, Some(0.9 * WEIGHT), |_| ());
    }
    lift.go_on(200, Some(WEIGHT), |_| ());
    assert!(
        lift.height > 0.05 && lift.speed < -0.2,
        "{} m, {} m/s",
        lift.height,
        lift.speed
    );
    let seen = capture(lift.now_ns() / 10_000_000 * 10_000_000, lift.height);
    lift.frozen = Some(-seen.position_world[2]);
    lift.go_on(100, Some(WEIGHT), |lift| {
        assert!(!lift.filter.state().unwrap().stands, "at {} m", lift.height);
    });
}
