//! Checks of the battery as the transmitter knows it.

use super::Findings;
use crate::{Key, LinkBattery, LowVoltageAction, RadioProtocol, RcLink, VoltageSource};

impl LinkBattery {
    pub(super) fn check(&self, link: &RcLink, has_phases: bool, at: &Key, found: &mut Findings) {
        match (self.source, &self.model) {
            (VoltageSource::Modelled, None) => found.add(
                at.clone(),
                "the voltage is modelled, and the model is not stated",
                "add `[rc_output.battery.model]` with `full`, `thrust`, `endurance` and `fade`, or measure the voltage",
            ),
            (VoltageSource::Measured, Some(_)) => found.add(
                at.then("model"),
                "the voltage is measured, so nothing uses the model",
                "leave it out, or state `source = \"modelled\"`",
            ),
            _ => {}
        }
        let is_silent = !link.link.has_telemetry() && !link.link.is_simulated();
        if self.source == VoltageSource::Measured && is_silent {
            let [others @ .., last] = RadioProtocol::ALL.map(|link| (link.has_telemetry(), link.name()));
            let others = others.into_iter().filter(|(has, _)| *has).map(|(_, name)| name);
            let others: Vec<_> = others.collect();
            found.add(
                at.then("source"),
                format!("over `{}` a vehicle sends nothing back", link.link.name()),
                format!(
                    "state `source = \"modelled\"`; {} and {} have telemetry",
                    others.join(", "),
                    last.1
                ),
            );
        }
        if self.calibrated.is_some() && link.link == RadioProtocol::Crazyflie {
            found.add(
                at.then("calibrated"),
                "a Crazyflie's firmware holds its newtons as the battery fades, and would be corrected twice",
                "leave `calibrated` out; `lowest` still warns",
            );
        }
        if self.below == LowVoltageAction::Land && !has_phases {
            found.add(
                at.then("below"),
                "a flight without phases cannot land",
                "add `[flight]`, or state `below = \"warn\"`",
            );
        }
        if self.below == LowVoltageAction::Land && self.lowest.is_none() {
            found.add(
                at.then("below"),
                "it acts below the lowest voltage, which is not stated",
                "state `lowest`",
            );
        }
        let [least, most] = self.factor;
        if !(least..=most).contains(&1.0) {
            found.add(
                at.then("factor"),
                format!("from {least:?} to {most:?} is not a range around 1"),
                "give the least factor first, such as [0.7, 1.5]",
            );
        }
    }
}
