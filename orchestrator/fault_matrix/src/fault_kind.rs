//! Kinds of faults in the matrix, with their parameters.

use std::str::FromStr;

use scenario::suggest::known_names;
use scenario::{Fault, FaultKind, FaultState, Scenario, Target};
use scenario_file::values::ValueError;
use serde::Serialize;
use shared_types::Topic;

use super::{DELAY, FRACTION, RANGE, injection_times};

/// Kind of fault of the matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(into = "&'static str")]
pub enum MatrixFault {
    /// A service dies and restarts from its last state.
    OffWarm,
    /// A service dies and restarts from its initial state.
    OffCold,
    /// A service stops stepping.
    Freeze,
    /// Samples arrive late.
    Delay,
    /// Samples are lost at random.
    Intermittent,
    /// Samples repeat the last one before the fault.
    Stuck,
    /// One field is wrong by a plausible amount.
    Wrong,
    /// All fields are random within a plausible range.
    GarbageInRange,
    /// All bits are random.
    Garbage,
}

impl MatrixFault {
    /// All kinds, those of services first.
    pub const ALL: [Self; 9] = [
        Self::OffWarm,
        Self::OffCold,
        Self::Freeze,
        Self::Delay,
        Self::Intermittent,
        Self::Stuck,
        Self::Wrong,
        Self::GarbageInRange,
        Self::Garbage,
    ];

    /// Returns the name on the command line and in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::OffWarm => "off-warm",
            Self::OffCold => "off-cold",
            Self::Freeze => "freeze",
            Self::Delay => "delay",
            Self::Intermittent => "intermittent",
            Self::Stuck => "stuck",
            Self::Wrong => "wrong",
            Self::GarbageInRange => "garbage-in-range",
            Self::Garbage => "garbage-any-bits",
        }
    }

    /// Returns the kind of fault in a scenario.
    #[must_use]
    pub fn kind(self) -> FaultKind {
        match self {
            Self::OffWarm | Self::OffCold => FaultKind::Off,
            Self::Freeze => FaultKind::Freeze,
            Self::Delay => FaultKind::Delay,
            Self::Intermittent => FaultKind::Intermittent,
            Self::Stuck => FaultKind::Stuck,
            Self::Wrong => FaultKind::Wrong,
            Self::GarbageInRange | Self::Garbage => FaultKind::Garbage,
        }
    }

    /// Returns whether the fault applies to a target: outages to services, all others to edges.
    #[must_use]
    pub fn applies_to(self, target: Target) -> bool {
        self.kind().is_outage() == matches!(target, Target::Service(_))
    }

    /// Returns the fault of a target from `at` for a duration, s.
    #[must_use]
    pub fn fault(self, target: Target, scenario: &Scenario, at: f64, lasts: f64) -> Fault {
        let mut fault = Fault::new(self.kind(), at);
        fault.lasts = Some(lasts);
        match target {
            Target::Service(service) => fault.service = Some(service.to_string()),
            Target::Edge(edge) => fault.edge = Some(edge.to_string()),
        }
        match self {
            Self::OffCold => fault.state = FaultState::Cold,
            Self::Delay => {
                fault.by = Some(injection_times::on_tick(scenario, DELAY).max(scenario.schedule.tick));
            }
            Self::Intermittent => fault.fraction = Some(FRACTION),
            Self::GarbageInRange => fault.range = Some(RANGE),
            Self::Wrong => {
                if let Target::Edge(edge) = target {
                    let Error { field, scale, bias } = Error::of(edge.topic);
                    fault.field = Some(field.to_owned());
                    fault.scale = scale;
                    fault.bias = bias;
                }
            }
            Self::OffWarm | Self::Freeze | Self::Stuck | Self::Garbage => {}
        }
        fault
    }
}

impl From<MatrixFault> for &'static str {
    fn from(fault: MatrixFault) -> Self {
        fault.name()
    }
}

/// Error of one field.
struct Error {
    field: &'static str,
    scale: Option<f64>,
    bias: Option<f64>,
}

impl Error {
    /// Returns a plausible error of a topic, which no check of a single sample detects: a position is off by 0.1 m, a
    /// thrust is 20 % too small, a fix is wrong by 1 m.
    fn of(topic: Topic) -> Self {
        let by = |field, bias| Self {
            field,
            scale: None,
            bias: Some(bias),
        };
        match topic {
            Topic::ControlCommand | Topic::RcFrame => Self {
                field: "thrust",
                scale: Some(0.8),
                bias: None,
            },
            Topic::ImuSample => by("specific_force_body.0", 0.3),
            // 1 m.
            Topic::GnssFix => by("latitude", 9e-6),
            Topic::GnssBaseline => by("baseline_ned.1", 0.1),
            Topic::BaroAltitude => by("altitude", 1.0),
            Topic::MagField => by("field_body.0", 0.02),
            _ => by("position_world.0", 0.1),
        }
    }
}

/// One or more kinds of faults under one name on the command line: `off` and `garbage` each mean two.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MatrixFaults(pub Vec<MatrixFault>);

impl FromStr for MatrixFaults {
    type Err = ValueError;

    fn from_str(name: &str) -> Result<Self, ValueError> {
        let all = MatrixFault::ALL.into_iter();
        let matching: Vec<_> = all
            .filter(|fault| fault.name() == name || fault.kind().name() == name)
            .collect();
        if matching.is_empty() {
            let names = FaultKind::ALL.map(FaultKind::name).into_iter();
            let mut names: Vec<_> = names.chain(MatrixFault::ALL.map(MatrixFault::name)).collect();
            names.sort_unstable();
            names.dedup();
            return Err(ValueError::Unknown {
                what: "fault",
                there_is: known_names(name, &names),
            });
        }
        Ok(Self(matching))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::services;
    use run_log::test_flight::scenario_of_own_controller as scenario;
    use scenario::EdgeName;

    #[test]
    fn every_fault_of_the_matrix_can_be_flown() {
        for tick in [0.001, 0.022, 0.1] {
            let plain = scenario(tick, 22.0);
            let services = services().map(Target::Service);
            let edges = EdgeName::all().filter(|edge| plain.has_samples(*edge));
            for target in services.chain(edges.map(Target::Edge)) {
                for fault in MatrixFault::ALL
                    .into_iter()
                    .filter(|fault| fault.applies_to(target))
                {
                    let mut scenario = plain.clone();
                    scenario.fault = vec![fault.fault(target, &scenario, 11.0, 2.2)];
                    assert_eq!(scenario.problems(), [], "{target}, {}", fault.name());
                }
            }
        }
    }

    #[test]
    fn a_kind_that_a_scenario_knows_means_all_that_the_matrix_makes_of_it() {
        assert_eq!(
            "off".parse(),
            Ok(MatrixFaults(vec![MatrixFault::OffWarm, MatrixFault::OffCold]))
        );
        assert_eq!("off-cold".parse(), Ok(MatrixFaults(vec![MatrixFault::OffCold])));
        assert_eq!(
            "garbage".parse(),
            Ok(MatrixFaults(vec![
                MatrixFault::GarbageInRange,
                MatrixFault::Garbage
            ]))
        );
        let unknown = "dealy".parse::<MatrixFaults>().unwrap_err().to_string();
        assert!(unknown.contains("did you mean `delay`"), "{unknown}");
    }
}
