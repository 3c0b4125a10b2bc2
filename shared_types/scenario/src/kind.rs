//! Kind of a role's occupant: the step logic of the experiment, a driver of real hardware, or an external service.

use super::{PoseSource, Scenario};
use shared_types::ServiceId;

/// Kind of a role's occupant. The registry has a constructor for every pair of role and kind that a scenario can state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The step logic of the experiment, which every host can step.
    StepLogic,
    /// The driver of a motion-capture system on the network, in place of the plant.
    MotionCapture,
    /// The captures of a recorded flight, in place of the plant.
    RecordedCaptures,
    /// The driver of receivers and autopilots that measure, and of cameras beside them, in place of the plant.
    Receivers,
    /// The transmitter's step logic, and the driver of a radio link behind it.
    RadioLink,
    /// An external service.
    Program,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 6] = [
        Self::StepLogic,
        Self::MotionCapture,
        Self::RecordedCaptures,
        Self::Receivers,
        Self::RadioLink,
        Self::Program,
    ];

    /// Returns the name of the process of this kind in a role.
    #[must_use]
    pub fn process_name(self, role: ServiceId) -> &'static str {
        match self {
            Self::MotionCapture | Self::RecordedCaptures => MOTION_CAPTURE,
            Self::Receivers => RECEIVERS,
            Self::StepLogic | Self::RadioLink | Self::Program => role.name(),
        }
    }
}

/// Name of the process that publishes captures in place of a simulated plant.
pub(crate) const MOTION_CAPTURE: &str = "motion_capture";

/// Name of the process that publishes samples of receivers in place of a simulated plant.
pub(crate) const RECEIVERS: &str = "receivers";

impl Scenario {
    /// Returns the kind in a role in real time. In simulated time there are no drivers.
    #[must_use]
    pub fn kind_of(&self, role: ServiceId) -> Kind {
        if self.program_of(role).is_some() {
            return Kind::Program;
        }
        match (role, self.pose_source()) {
            (ServiceId::Plant, _) if self.real_receivers().is_some() => Kind::Receivers,
            (ServiceId::Plant, PoseSource::Replay) => Kind::RecordedCaptures,
            (ServiceId::Plant, source) if source.system().is_some() => Kind::MotionCapture,
            (ServiceId::RcOutput, _) if self.radio_link().is_some() => Kind::RadioLink,
            _ => Kind::StepLogic,
        }
    }

    /// Returns whether cameras or receivers measure a real vehicle.
    #[must_use]
    pub fn measures_a_vehicle(&self) -> bool {
        self.capture_system().is_some() || self.real_receivers().is_some()
    }

    /// Returns the name of the process in a role, in listings of processes, messages and tables.
    #[must_use]
    pub fn process_name(&self, role: ServiceId) -> &'static str {
        self.kind_of(role).process_name(role)
    }
}

/// Returns the role of a process, by its name.
#[must_use]
pub fn role_of_process(name: &str) -> Option<ServiceId> {
    let driver_role = [MOTION_CAPTURE, RECEIVERS]
        .contains(&name)
        .then_some(ServiceId::Plant);
    driver_role.or_else(|| ServiceId::from_name(name))
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;
    use crate::tests_support::rig;
    use crate::{CaptureSystem, Deployment, MotionCapture, ServiceDeployment};

    #[test]
    fn in_a_laboratory_no_process_is_called_plant() {
        let mut scenario = rig();
        assert_eq!(scenario.process_name(ServiceId::Plant), "plant");
        let system = MotionCapture::new(CaptureSystem::Vrpn, Ipv4Addr::LOCALHOST, "quad");
        for source in [PoseSource::Vrpn, PoseSource::Replay] {
            scenario.motion_capture = Some(MotionCapture {
                source,
                recording: Some("runs/fig7".to_owned()),
                ..system.clone()
            });
            assert_eq!(scenario.process_name(ServiceId::Plant), "motion_capture");
        }
        let own = Some(ServiceDeployment {
            core: Some(1),
            ..ServiceDeployment::default()
        });
        scenario.deployment = Some(Deployment {
            motion_capture: own,
            ..Deployment::default()
        });
        assert_eq!(scenario.problems(), []);
        assert_eq!(scenario.deployment_of(ServiceId::Plant).core, Some(1));
        scenario.deployment.as_mut().unwrap().plant = own;
        let [problem] = &scenario.problems()[..] else {
            panic!("{:?}", scenario.problems())
        };
        assert_eq!(problem.fix, "name the table `deployment.motion_capture`");
        for role in ServiceId::ALL {
            assert_eq!(role_of_process(scenario.process_name(role)), Some(role));
        }
    }
}
