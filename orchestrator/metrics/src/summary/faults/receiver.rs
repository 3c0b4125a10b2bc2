//! Planned faults of the simulated satellite receiver: other fixes than at the start, and spoofing.

use scenario::{Fixes, Scenario};

/// A planned fault of the receiver.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceiverFault {
    /// Time at which it begins, s.
    pub at: f64,
    /// End, s; `None` if permanent.
    pub until: Option<f64>,
    /// `true` of spoofing, `false` of other fixes.
    pub is_spoofing: bool,
    /// What the receiver does, in words.
    pub words: String,
    /// The same of its end, where no other change follows.
    pub end_in_words: String,
}

impl ReceiverFault {
    /// Returns the planned faults of a scenario's receiver: each change to other fixes than at the start, until the next
    /// change, then each interval of spoofing.
    #[must_use]
    pub fn all(scenario: &Scenario) -> Vec<Self> {
        let Some(gnss) = scenario.sensors.as_ref().map(|sensors| &sensors.gnss) else {
            return Vec::new();
        };
        let next = gnss.change.iter().skip(1).map(Some).chain([None]);
        let changes = gnss.change.iter().zip(next);
        let changes = changes.filter(|(change, _)| change.kind != gnss.kind);
        let changes = changes.map(|(change, next)| Self {
            at: change.at,
            until: next.map(|next| next.at),
            is_spoofing: false,
            words: format!(
                "receiver has {} fixes, not {}",
                name(change.kind),
                name(gnss.kind)
            ),
            end_in_words: format!(
                "receiver has {} fixes",
                name(next.map_or(gnss.kind, |next| next.kind))
            ),
        });
        let spoofing = gnss.spoofing.iter().map(|spoofing| {
            let [x, y, z] = spoofing.velocity;
            Self {
                at: spoofing.at,
                until: Some(spoofing.at + spoofing.lasts),
                is_spoofing: true,
                words: format!("fixes drift away by [{x}, {y}, {z}] m/s"),
                end_in_words: "fixes drift no more".to_owned(),
            }
        });
        changes.chain(spoofing).collect()
    }
}

fn name(fixes: Fixes) -> &'static str {
    match fixes {
        Fixes::None => "no",
        Fixes::SinglePoint => "single_point",
        Fixes::RtkFloat => "rtk_float",
        Fixes::RtkFixed => "rtk_fixed",
    }
}
