//! Verdicts on the flights of the matrix.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::SURVIVES;
use super::flight::{Ended, FaultEffect};
use metrics::loss::Reason;

/// Verdict on the vehicle, from best to worst.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Survival {
    /// The distance stayed within [`SURVIVES`] times the bound.
    Survived,
    /// The distance exceeded that, and the vehicle returned inside the bound for good or stood disarmed at the end; or it was
    /// made to land.
    Degraded,
    /// The vehicle did not return or land, or was lost by the limits of the scenario, a number was not finite, or a service
    /// died.
    Lost,
}

impl Survival {
    pub const ALL: [Self; 3] = [Self::Survived, Self::Degraded, Self::Lost];

    /// Returns the name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Survived => "survived",
            Self::Degraded => "degraded",
            Self::Lost => "LOST",
        }
    }
}

/// Reason of a loss.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MatrixLoss {
    pub reason: Cow<'static, str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub details: Option<String>,
}

impl MatrixLoss {
    fn new(reason: &'static str) -> Self {
        Self {
            reason: reason.into(),
            details: None,
        }
    }
}

/// Returns the verdict on a flight, with the reason of a loss.
#[must_use]
pub fn judge(effect: &FaultEffect) -> (Survival, Option<MatrixLoss>) {
    if let Some(loss) = loss(effect) {
        return (Survival::Lost, Some(loss));
    }
    let report = effect.report.as_ref().filter(|report| !report.lands);
    let share = report.and_then(|report| report.largest_share);
    let verdict = if share.is_some_and(|share| share <= SURVIVES) {
        Survival::Survived
    } else {
        Survival::Degraded
    };
    (verdict, None)
}

fn loss(effect: &FaultEffect) -> Option<MatrixLoss> {
    match &effect.ended {
        Some(Ended::NotFinite(words)) => {
            return Some(MatrixLoss {
                reason: "not finite".into(),
                details: Some(words.clone()),
            });
        }
        Some(Ended::Died) => return Some(MatrixLoss::new("a service died")),
        None => {}
    }
    if let Some(loss) = &effect.loss {
        return Some(MatrixLoss {
            reason: match loss.reason {
                Reason::LeftPath => "left the path",
                Reason::TippedOver => "tipped over",
                Reason::HitGround => "hit the ground",
                Reason::MotorsStopped => "motors stopped",
                Reason::LinkLost => "link lost",
                Reason::Unseen => "not seen",
                Reason::NotFinite => "not finite",
            }
            .into(),
            details: Some(format!("lost at {} s: {loss}", loss.time)),
        });
    }
    // In a landing and on the ground there is no path to return to: only the limits judge a touch-down.
    let report = effect.report.as_ref();
    if effect.stands_disarmed {
        return None;
    }
    if report.is_some_and(|report| report.lands) {
        return Some(MatrixLoss::new("still in the air"));
    }
    let Some((report, share)) = report.and_then(|report| Some((report, report.largest_share?))) else {
        return Some(MatrixLoss::new("it is not known where the vehicle was"));
    };
    let is_back = share <= SURVIVES || report.back_after.is_some();
    (!is_back).then(|| MatrixLoss::new("did not come back"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use metrics::summary::faults::{FaultReport, Reactions};

    /// A flight whose error was 4 cm at most before the fault.
    fn flown(peak: f64, back_after: Option<f64>) -> FaultEffect {
        FaultEffect {
            report: Some(FaultReport {
                fault: String::new(),
                begins: 1.0,
                ends: Some(1.1),
                outage: 0.1,
                watched_until: 9.1,
                lands: false,
                detection: None,
                bound: 0.04,
                peak_error: Some(peak),
                largest_share: Some(peak / 0.04),
                back_after,
                reactions: Reactions::default(),
                others: String::new(),
            }),
            loss: None,
            stands_disarmed: false,
            ended: None,
        }
    }

    #[test]
    fn a_vehicle_survives_is_degraded_or_lost_by_how_far_it_strayed_and_whether_it_came_back() {
        for (peak, back_after, verdict) in [
            (0.059, Some(0.0), Survival::Survived),
            (0.059, None, Survival::Survived),
            (0.061, Some(3.0), Survival::Degraded),
            (0.061, None, Survival::Lost),
            (4.9, Some(3.0), Survival::Degraded),
        ] {
            let (judged, why) = judge(&flown(peak, back_after));
            assert_eq!(judged, verdict, "{peak} {back_after:?}");
            assert_eq!(why.is_some(), verdict == Survival::Lost);
        }
    }

    #[test]
    fn a_vehicle_that_has_landed_need_not_come_back_to_its_path() {
        for report in [flown(0.2, None).report, flown(0.01, None).report, None] {
            let strays = report.as_ref().and_then(|report| report.peak_error) != Some(0.01);
            let landed = FaultEffect {
                report,
                stands_disarmed: true,
                ..flown(0.2, None)
            };
            let verdict = if strays {
                Survival::Degraded
            } else {
                Survival::Survived
            };
            assert_eq!(judge(&landed), (verdict, None));
        }
    }

    #[test]
    fn a_vehicle_that_was_made_to_land_is_degraded_however_near_it_was_before() {
        for (peak, back_after) in [(0.01, Some(0.0)), (0.2, None)] {
            let mut flown = flown(peak, back_after);
            flown.report.as_mut().unwrap().lands = true;
            let (judged, why) = judge(&flown);
            assert_eq!(
                (judged, &*why.unwrap().reason),
                (Survival::Lost, "still in the air")
            );
            flown.stands_disarmed = true;
            assert_eq!(judge(&flown), (Survival::Degraded, None));
        }
    }

    #[test]
    fn a_vehicle_that_is_lost_or_whose_flight_the_fault_ended_is_lost_however_near_it_was() {
        let near = flown(0.01, Some(0.0));
        let tipped = FaultEffect {
            loss: Some(metrics::loss::Loss {
                reason: Reason::TippedOver,
                time: 1.05,
                value: Some(1.6),
                limit: Some(1.5),
                stopped_by: 0,
                cause: None,
                source: metrics::tracker::StateSource::Truth,
            }),
            ..near.clone()
        };
        let [not_finite, died] = [
            Ended::NotFinite("`plant` computed a number that is not finite".to_owned()),
            Ended::Died,
        ]
        .map(|ended| FaultEffect {
            ended: Some(ended),
            ..near.clone()
        });
        let unseen = FaultEffect { report: None, ..near };
        for lost in [tipped, not_finite, died, unseen] {
            assert_eq!(judge(&lost).0, Survival::Lost, "{lost:?}");
        }
    }
}
