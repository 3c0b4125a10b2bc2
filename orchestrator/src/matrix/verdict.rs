//! Judging a flight of the matrix.

use serde::Serialize;

use super::flight::Flown;
use super::{LOST, SURVIVES};

/// What became of the vehicle. The worst comes last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It strayed no further than [`SURVIVES`] times the bound.
    Survived,
    /// It did, and came back inside the bound for good.
    Degraded,
    /// It did not come back, came [`LOST`] away from the path, tipped over, or a number was not finite.
    Lost,
}

impl Verdict {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Survived, Self::Degraded, Self::Lost];

    /// As tables show it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Survived => "survived",
            Self::Degraded => "degraded",
            Self::Lost => "LOST",
        }
    }
}

/// The verdict on a flight, and for one that is lost why.
#[must_use]
pub fn judge(flown: &Flown) -> (Verdict, Option<String>) {
    let lost = |reason: &str| (Verdict::Lost, Some(reason.to_owned()));
    if let Some(reason) = &flown.not_finite {
        return lost(reason);
    }
    let Some((report, peak)) = flown
        .report
        .as_ref()
        .and_then(|report| Some((report, report.peak_error?)))
    else {
        return lost("it is not known where the vehicle was");
    };
    if flown.has_tipped {
        lost("tipped over")
    } else if peak > LOST {
        lost("left the path")
    } else if peak <= SURVIVES * report.bound {
        (Verdict::Survived, None)
    } else if report.back_after.is_some() {
        (Verdict::Degraded, None)
    } else {
        lost("did not come back")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::summary::faults::{FaultReport, Reactions};

    /// A flight whose error was 4 cm at most before the fault.
    fn flown(peak: f64, back_after: Option<f64>) -> Flown {
        Flown {
            report: Some(FaultReport {
                fault: String::new(),
                begins: 1.0,
                ends: Some(1.1),
                outage: 0.1,
                watched_until: 9.1,
                detection: None,
                bound: 0.04,
                peak_error: Some(peak),
                back_after,
                reactions: Reactions::default(),
                others: String::new(),
            }),
            has_tipped: false,
            not_finite: None,
            digest: None,
        }
    }

    #[test]
    fn a_vehicle_survives_is_degraded_or_lost_by_how_far_it_strayed_and_whether_it_came_back() {
        for (peak, back_after, verdict) in [
            (0.059, Some(0.0), Verdict::Survived),
            (0.059, None, Verdict::Survived),
            (0.061, Some(3.0), Verdict::Degraded),
            (0.061, None, Verdict::Lost),
            (4.9, Some(3.0), Verdict::Degraded),
            (5.1, Some(3.0), Verdict::Lost),
        ] {
            let (judged, why) = judge(&flown(peak, back_after));
            assert_eq!(judged, verdict, "{peak} {back_after:?}");
            assert_eq!(why.is_some(), verdict == Verdict::Lost);
        }
    }

    #[test]
    fn a_vehicle_that_tips_over_or_computes_what_is_not_finite_is_lost_however_near_it_was() {
        let near = flown(0.01, Some(0.0));
        let tipped = Flown {
            has_tipped: true,
            ..near.clone()
        };
        let not_finite = Flown {
            not_finite: Some("`plant` computed a number that is not finite".to_owned()),
            ..near.clone()
        };
        let unseen = Flown { report: None, ..near };
        for lost in [tipped, not_finite, unseen] {
            assert_eq!(judge(&lost).0, Verdict::Lost, "{lost:?}");
        }
    }
}
