//! Scenarios of the settings.

use std::collections::BTreeMap;

use scenario::{
    Curve, Flight, KillSwitchLoss, OperatorDevices, Path, Programs, Scenario, TiltedEight, Timing, Vehicle,
};
use shared_types::Schedule;

use crate::history::Setting;
use crate::vehicle::Vehicle as Flown;

/// Scenarios and their schedules, made once for each setting, and the vehicle.
#[derive(Default)]
pub struct Flights {
    known: Vec<(Key, Box<(Scenario, Schedule)>)>,
    vehicle: Option<Box<Flown>>,
}

type Key = (u64, bool, bool, Option<u8>);

impl Flights {
    /// Returns the scenario of a setting, its schedule, and the vehicle.
    pub fn of(&mut self, setting: Setting) -> (&Scenario, &Schedule, &mut Option<Box<Flown>>) {
        let Setting {
            length_ms,
            has_phases,
            is_slow,
            external,
            ..
        } = setting;
        let key = (length_ms, has_phases, is_slow, external);
        // Short flights have many lengths, which are not worth to be kept.
        let found = self.known.iter().position(|(other, _)| *other == key);
        let at = found.unwrap_or_else(|| {
            if self.known.len() > 64 {
                self.known.truncate(32);
            }
            self.known.push((key, Box::new(flight(setting))));
            self.known.len() - 1
        });
        let (scenario, schedule) = &*self.known[at].1;
        (scenario, schedule, &mut self.vehicle)
    }
}

fn flight(setting: Setting) -> (Scenario, Schedule) {
    let seconds = setting.length_ms as f64 / 1e3;
    let vehicle = Vehicle::new(0.2, [6.5e-4, 6.5e-4, 13.0e-4]);
    let mut scenario = Scenario::new(
        seconds,
        vehicle,
        Path::new(Curve::TiltedEight(TiltedEight::default())),
    );
    if setting.is_slow {
        let periods = [
            ("mocap/pose", 0.01),
            ("vehicle/state", 0.022),
            ("path_generator", 0.022),
            ("controller", 0.022),
            ("rc_output", 0.022),
        ];
        let periods = periods.map(|(name, period)| (name.to_owned(), period));
        scenario.schedule = Timing {
            period: BTreeMap::from(periods),
            ..Timing::default()
        };
    }
    scenario.flight = setting.has_phases.then(Flight::default);
    scenario.operator = Some(OperatorDevices {
        kill_device: "/dev/input/by-id/key".to_owned(),
        kill_key: None,
        kill_baud: 9600,
        on_loss: match setting.is_slow {
            true => KillSwitchLoss::Kill,
            false => KillSwitchLoss::Land,
        },
    });
    let program = |index: u8| {
        setting
            .external
            .filter(|&external| external == index)
            .map(|_| vec!["program".to_owned()])
    };
    if setting.external.is_some() {
        scenario.programs = Some(Programs {
            folder: None,
            plant: program(0),
            estimator: program(1),
            path_generator: program(2),
            controller: program(3),
            rc_output: program(4),
        });
    }
    let schedule = scenario.schedule();
    let schedule = schedule.expect("the periods are multiples of the tick");
    (scenario, schedule)
}
