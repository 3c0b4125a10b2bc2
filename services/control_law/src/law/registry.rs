//! Registry of laws: the constructor of each. There is no other list of them.

use scenario::{LawKind, Scenario};

use super::baseline_law::BaselineLaw;
use super::flight_law::FlightLaw;

/// Makes the law of a checked scenario.
#[must_use]
pub fn flight_law(scenario: &Scenario) -> Box<dyn FlightLaw> {
    match scenario.controller.law {
        LawKind::Adaptive => Box::new(crate::adaptive::flight_law::AdaptiveFlightLaw::new(scenario)),
        LawKind::GeometricPid => Box::new(BaselineLaw::<super::geometric_pid::GeometricPid>::new(scenario)),
        LawKind::L1 => Box::new(BaselineLaw::<super::l1::L1>::new(scenario)),
        LawKind::Indi => Box::new(BaselineLaw::<super::indi::Indi>::new(scenario)),
        LawKind::NfConstant => Box::new(BaselineLaw::<super::nf_constant::NfConstant>::new(scenario)),
        LawKind::Px4 => Box::new(BaselineLaw::<super::px4::Px4>::new(scenario)),
        LawKind::ImmersionMass => {
            Box::new(BaselineLaw::<super::immersion_mass::ImmersionMass>::new(scenario))
        }
        LawKind::ImmersionInertia => Box::new(super::immersion_inertia::ImmersionInertia::new(scenario)),
        LawKind::Nmpc => Box::new(super::nmpc::Nmpc::new(scenario)),
    }
}
