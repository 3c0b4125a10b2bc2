//! The control laws of a grid: settings of a scenario, by name.

use scenario::{Key, LawKind};
use scenario_file::key_of_setting;
use scenario_file::values::{ValueError, plain_name};
use serde::Serialize;
use shared_types::ServiceId;

use crate::error::GridError;
use crate::flights::Base;

/// A control law.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ControlLaw {
    /// Name in tables and on the command line.
    pub name: String,
    /// Settings that select the law.
    pub settings: Vec<String>,
}

/// Built-in laws, each with the gains stated in docs/laws.md.
const LAWS: [(&str, &[&str]); 16] = [
    ("paper-1", &["controller.lambda_disturbance=[1.0, 1.0, 1.0]"]),
    ("paper-18", &["controller.lambda_disturbance=[18.0, 18.0, 18.0]"]),
    ("paper-30", &["controller.lambda_disturbance=[30.0, 30.0, 30.0]"]),
    (
        "composite-8",
        &[
            "controller.lambda_disturbance=[8.0, 8.0, 8.0]",
            "controller.prediction_gain=1.9",
        ],
    ),
    (
        "composite-40",
        &[
            "controller.lambda_disturbance=[40.0, 40.0, 40.0]",
            "controller.prediction_gain=0.3",
        ],
    ),
    (
        "harmonics-18",
        &[
            "controller.lambda_disturbance=[18.0, 18.0, 18.0]",
            "controller.harmonics={}",
        ],
    ),
    (
        "observer",
        &[
            "controller.lambda_disturbance=[1.0, 1.0, 1.0]",
            "controller.disturbance_observer=true",
        ],
    ),
    (
        "style-27",
        &[
            "controller.lambda_mass=0.0",
            "controller.lambda_disturbance=[0.0, 0.0, 0.0]",
        ],
    ),
    ("geometric_pid", &["controller.law=geometric_pid"]),
    ("l1", &["controller.law=l1"]),
    ("indi", &["controller.law=indi"]),
    ("nf_constant", &["controller.law=nf_constant"]),
    ("px4", &["controller.law=px4"]),
    (
        "px4-stock",
        &["controller.law=px4", "controller.baseline.cascade_scale=1.0"],
    ),
    ("immersion_mass", &["controller.law=immersion_mass"]),
    ("nmpc", &["controller.law=nmpc"]),
];

impl ControlLaw {
    /// Returns the built-in laws.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let law = |(name, settings): (&str, &[&str])| Self {
            name: name.to_owned(),
            settings: settings.iter().map(|&setting| setting.to_owned()).collect(),
        };
        LAWS.map(law).into()
    }
}

// Reasons why a law may not set a key.
const MEASURE: &str = "it decides how flights are measured, which is the same for all laws of a grid";
const EXPERIMENT: &str = "it is the same for all laws of a grid";

/// Parts of a scenario that a law may not set, with the reason; conditions and margins change some of them.
const SHARED: [(&[&str], &str); 17] = [
    (&["judge"], MEASURE),
    (&["flight"], MEASURE),
    (&["record"], MEASURE),
    (&["duration"], MEASURE),
    (&["schedule", "tick"], MEASURE),
    (&["seed"], EXPERIMENT),
    (&["vehicle"], EXPERIMENT),
    (&["cameras"], EXPERIMENT),
    (&["motion_capture"], EXPERIMENT),
    (&["path"], EXPERIMENT),
    (&["plugins", "plant"], EXPERIMENT),
    (&["plugins", "path_generator"], EXPERIMENT),
    (&["fault"], EXPERIMENT),
    (&["operator"], EXPERIMENT),
    (&["schedule", "latency"], EXPERIMENT),
    (&["schedule", "period", "mocap/pose"], EXPERIMENT),
    (&["schedule", "phase", "mocap/pose"], EXPERIMENT),
];

/// Returns the reason why a law may not set a key, if so.
fn refusal(key: &Key) -> Option<String> {
    let mut parts = SHARED
        .iter()
        .map(|(part, reason)| (part.iter().copied().collect::<Key>(), reason));
    let (shared, reason) = parts.find(|(part, _)| part.overlaps(key))?;
    let what = if shared.segments().len() > key.segments().len() {
        format!("`{key}` has `{shared}`, which is")
    } else {
        format!("`{key}` is")
    };
    Some(format!("{what} no part of a law: {reason}"))
}

/// Factors on the bandwidth of a law's position loop, along which its front is measured.
const BANDWIDTHS: [f64; 5] = [0.6, 0.8, 1.0, 1.25, 1.6];

impl ControlLaw {
    /// Returns the law with slower and faster position loops, as `NAME×FACTOR`. The damping and the loops that estimate or filter
    /// a disturbance are unchanged.
    ///
    /// # Errors
    /// [`GridError`] if a setting of the law does not fit the base, or the law is a plug-in.
    pub fn along_bandwidth(&self, base: &Base) -> Result<Vec<Self>, GridError> {
        let scenario = base.scenario(&self.settings, 1)?;
        if scenario.is_foreign(ServiceId::Controller) {
            return Err(GridError::BadInput(format!(
                "--along-bandwidth changes the gains of the position loop, but those of the plug-in of `{}` are not accessible to \
                 gerono: omit it, and define a law for each bandwidth by `plugins.parameters` of the plug-in",
                self.name
            )));
        }
        let controller = scenario.controller;
        let baseline = controller.baseline.unwrap_or_default();
        let with = |factor: f64| {
            let gains = match controller.law {
                LawKind::Adaptive => vec![("k1", controller.k1 * factor), ("k2", controller.k2 * factor)],
                LawKind::Px4 => vec![("baseline.cascade_scale", baseline.cascade_scale * factor)],
                // Three integrators lie between body rate and position: the optimal bandwidth is proportional to the sixth root
                // of the ratio of the weights.
                LawKind::Nmpc => vec![(
                    "baseline.nmpc_rate_weight",
                    baseline.nmpc_rate_weight / libm::pow(factor, 6.0),
                )],
                LawKind::GeometricPid => vec![
                    ("baseline.position_gain", baseline.position_gain * factor * factor),
                    ("baseline.velocity_gain", baseline.velocity_gain * factor),
                    ("baseline.integral_gain", baseline.integral_gain * factor * factor),
                ],
                _ => vec![
                    ("baseline.position_gain", baseline.position_gain * factor * factor),
                    ("baseline.velocity_gain", baseline.velocity_gain * factor),
                ],
            };
            let gains = gains
                .into_iter()
                .map(|(key, gain)| format!("controller.{key}={gain:?}"));
            Self {
                name: format!("{}×{factor}", self.name),
                settings: self.settings.iter().cloned().chain(gains).collect(),
            }
        };
        Ok(BANDWIDTHS.map(with).into())
    }

    /// Returns the name of the law that a variant of [`Self::along_bandwidth`] is derived from; other names unchanged.
    #[must_use]
    pub fn family(name: &str) -> &str {
        name.split_once('×').map_or(name, |(family, _)| family)
    }
}

impl std::str::FromStr for ControlLaw {
    type Err = ValueError;

    /// Parses the name of a built-in law, or `NAME:KEY=VALUE;KEY=VALUE…` for a user-defined one.
    fn from_str(text: &str) -> Result<Self, ValueError> {
        match text.split_once(':') {
            Some((name, settings)) => Self::user_defined(name, settings),
            None => Self::built_in(text).ok_or_else(|| {
                let names = LAWS.map(|(name, _)| name).join(", ");
                ValueError::Unknown {
                    what: "law",
                    there_is: format!("there is {names}, and NAME:KEY=VALUE for one of your own"),
                }
            }),
        }
    }
}

impl ControlLaw {
    fn built_in(name: &str) -> Option<Self> {
        Self::all().into_iter().find(|law| law.name == name)
    }

    /// Parses a user-defined law.
    fn user_defined(name: &str, settings: &str) -> Result<Self, ValueError> {
        plain_name(name)?;
        let settings: Vec<_> = settings.split(';').map(str::to_owned).collect();
        let key_of = |setting: &String| {
            let refusal = || {
                ValueError::unfit(format!(
                    "`{setting}` is not KEY=VALUE, such as `controller.k1=2.0`"
                ))
            };
            key_of_setting(setting).ok_or_else(refusal)
        };
        let keys: Vec<Key> = settings.iter().map(key_of).collect::<Result<_, _>>()?;
        if let Some(refusal) = keys.iter().find_map(refusal) {
            return Err(ValueError::unfit(refusal));
        }
        if let Some((_, twice)) = (1..).zip(&keys).find(|(next, key)| keys[*next..].contains(key)) {
            return Err(ValueError::unfit(format!("`{twice}` is stated twice")));
        }
        let law = Self {
            name: name.to_owned(),
            settings,
        };
        match Self::built_in(name) {
            Some(built_in) => Err(ValueError::unfit(law.name_conflict(&built_in))),
            None => Ok(law),
        }
    }

    /// Returns the error for a law with the name of a built-in one, with a definition that would be valid.
    fn name_conflict(&self, built_in: &Self) -> String {
        let name = &self.name;
        let own: Vec<_> = self
            .settings
            .iter()
            .map(|setting| key_of_setting(setting))
            .collect();
        let is_kept = |setting: &&String| !own.contains(&key_of_setting(setting));
        let kept = built_in.settings.iter().filter(is_kept);
        let settings: Vec<_> = kept.chain(&self.settings).map(String::as_str).collect();
        format!(
            "`{name}` is a built-in law, and these settings alone do not define it: choose another name and state all \
             settings, such as '{name}-own:{}'",
            settings.join(";")
        )
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;
    use crate::conditions::{CONDITIONS, MARGINS};

    #[test]
    fn laws_are_found_by_name_and_made_of_settings() {
        for law in ControlLaw::all() {
            assert_eq!(law.name.parse::<ControlLaw>().unwrap(), law);
        }
        let own: ControlLaw = "mine:plugins.controller=libmine.so;controller.k1=3.0"
            .parse()
            .unwrap();
        assert_eq!((own.name.as_str(), own.settings.len()), ("mine", 2));
        assert_eq!(own.settings[1], "controller.k1=3.0");
        for wrong in [
            "unknown",
            "a:seed=9",
            "a:vehicle.mass=0.17",
            "a:schedule.latency.\"rc/frame -> plant\"=0.004",
            "a:schedule.latency={}",
            "a:schedule.period={}",
            "a:plugins={plant=\"x.so\"}",
            "a:plugins.path_generator=x.so",
            "a:controller.k1=4.0;controller.k1=4.5",
            ":controller.k1=4.0",
            "a|b:controller.k1=4.0",
            "a`b:controller.k1=4.0",
            "a\nb:controller.k1=4.0",
            "a×2:controller.k1=4.0",
        ] {
            assert!(wrong.parse::<ControlLaw>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_law_without_a_setting_is_refused_with_the_form() {
        for (law, named) in [("a:b", "`b`"), ("a:", "``"), ("a:controller.k1=2.0;k2", "`k2`")] {
            let refused = law.parse::<ControlLaw>().unwrap_err().to_string();
            assert!(
                refused.starts_with(&format!("{named} is not KEY=VALUE")),
                "{law}: {refused}"
            );
        }
    }

    #[test]
    fn a_law_does_not_choose_how_it_is_measured() {
        for key in [
            "judge.distance_max=50.0",
            "judge={steady_after=19.0}",
            "flight={}",
            "record={}",
            "schedule.tick=0.0005",
        ] {
            let refused = format!("a:{key}").parse::<ControlLaw>().unwrap_err().to_string();
            assert!(refused.contains("how flights are measured"), "{refused}");
        }
    }

    #[test]
    fn a_law_with_the_name_of_one_of_geronos_is_refused_with_what_would_fly() {
        for (text, fix) in [
            (
                "indi:controller.baseline.position_gain=64.0",
                "indi-own:controller.law=indi;controller.baseline.position_gain=64.0",
            ),
            (
                "composite-40:controller.prediction_gain=0.5",
                "composite-40-own:controller.lambda_disturbance=[40.0, 40.0, 40.0];controller.prediction_gain=0.5",
            ),
        ] {
            let refused = text.parse::<ControlLaw>().unwrap_err().to_string();
            assert!(refused.ends_with(&format!("'{fix}'")), "{refused}");
            assert!(fix.parse::<ControlLaw>().is_ok());
        }
    }

    #[test]
    fn no_law_undoes_a_condition_or_a_margin() {
        let base = Base::load(None).unwrap();
        let margin_settings = MARGINS
            .iter()
            .flat_map(|quantity| quantity.settings(base.stated(), 1.0).unwrap());
        let condition_settings = CONDITIONS
            .iter()
            .flat_map(|condition| condition.for_scenario(base.stated()).unwrap().settings);
        for setting in condition_settings.chain(margin_settings) {
            // The margin "start, limited error" limits the error of a law that states no limit of its own.
            let is_limit = setting == "controller.baseline.error_limit=0.4";
            let law = format!("a:{setting}").parse::<ControlLaw>();
            assert_eq!(law.is_ok(), is_limit, "{setting}");
        }
    }

    #[test]
    fn along_the_bandwidth_the_damping_stays() {
        let base = Base::load(None).unwrap();
        let indi: ControlLaw = "indi".parse().unwrap();
        let along = indi.along_bandwidth(&base).unwrap();
        let names: Vec<_> = along.iter().map(|law| law.name.as_str()).collect();
        assert_eq!(names, ["indi×0.6", "indi×0.8", "indi×1", "indi×1.25", "indi×1.6"]);
        assert!(names.iter().all(|name| ControlLaw::family(name) == "indi"));
        let damping = |law: &ControlLaw| {
            let gains = base
                .scenario(&law.settings, 1)
                .unwrap()
                .controller
                .baseline
                .unwrap();
            gains.velocity_gain / gains.position_gain.sqrt()
        };
        assert!(
            along
                .iter()
                .all(|law| (damping(law) - damping(&along[2])).abs() < 1e-12)
        );
        // Of each kind of law something changes with each factor.
        for law in ControlLaw::all() {
            let along = law.along_bandwidth(&base).unwrap();
            let controllers: Vec<_> = along
                .iter()
                .map(|law| base.scenario(&law.settings, 1).unwrap().controller)
                .collect();
            assert!(
                controllers.windows(2).all(|pair| pair[0] != pair[1]),
                "{}",
                law.name
            );
        }
    }

    #[test]
    fn of_a_plug_in_gerono_knows_no_bandwidth() {
        let folder = tempfile::tempdir().unwrap();
        let library = folder.path().join("libmine.so");
        std::fs::write(&library, "a library").unwrap();
        let law = format!("mine:plugins.controller={}", library.display());
        let law: ControlLaw = law.parse().unwrap();
        let base = Base::load(None).unwrap();
        let refused = law.along_bandwidth(&base).unwrap_err().to_string();
        assert!(refused.contains("those of the plug-in of `mine`"), "{refused}");
        let scenario = base.scenario(&law.settings, 1).unwrap();
        let margins = MARGINS.iter().filter(|quantity| quantity.applies_to(&scenario));
        let names: Vec<_> = margins.map(|quantity| quantity.name).collect();
        assert_eq!(names.last(), Some(&"start"));
        assert_eq!(names.len(), MARGINS.len() - 1);
    }
}
