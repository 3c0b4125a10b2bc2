//! The control laws of a grid: settings of a scenario, by name.

use command_line::values::ValueError;
use serde::Serialize;

/// A control law.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ControlLaw {
    /// Its name in tables and on the command line.
    pub name: String,
    /// The settings that choose it.
    pub settings: Vec<String>,
}

/// The laws of Gerono, each with the gains that docs/laws.md names.
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
    /// Returns the laws of Gerono.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let law = |(name, settings): (&str, &[&str])| Self {
            name: name.to_owned(),
            settings: settings.iter().map(|&setting| setting.to_owned()).collect(),
        };
        LAWS.map(law).into()
    }
}

impl std::str::FromStr for ControlLaw {
    type Err = ValueError;

    /// Reads the name of a law, or `NAME:KEY=VALUE;KEY=VALUE…` for one of the user's own.
    fn from_str(text: &str) -> Result<Self, ValueError> {
        if let Some((name, settings)) = text.split_once(':') {
            return Ok(Self {
                name: name.to_owned(),
                settings: settings.split(';').map(str::to_owned).collect(),
            });
        }
        let mut all = Self::all();
        match all.iter().position(|law| law.name == text) {
            Some(index) => Ok(all.swap_remove(index)),
            None => Err(ValueError::Unknown {
                what: "law",
                there_is: format!(
                    "there is {}, and NAME:KEY=VALUE for one of your own",
                    all.iter()
                        .map(|law| law.name.as_str())
                        .collect::<Vec<_>>()
                        .join(", ")
                ),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert!("unknown".parse::<ControlLaw>().is_err());
    }
}
