//! Scenarios in serde's formats.
//!
//! The derived functions are compiled for each format in each crate that uses them, in about 10 s. So they are inherent
//! functions, which this crate uses for JSON and `scenario_file` for TOML. The implementations of serde's traits, which
//! all other crates use, convert to and from a tree of JSON values, in which the order of keys is that of the alphabet.

use serde::de::Error as _;
use serde::ser::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;

use crate::Scenario;

impl Scenario {
    /// Converts from JSON.
    ///
    /// # Errors
    /// If a key is unknown or missing, or has a value of another type.
    pub fn from_json(tree: Value) -> serde_json::Result<Self> {
        // The derived function, not that of the trait.
        Self::deserialize(tree)
    }

    /// Converts to JSON, in the order of the declarations.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string(&AsDeclared(self)).expect("a scenario has only string keys")
    }
}

/// Scenario as it is declared, for serializers that tell structures from maps.
pub(crate) struct AsDeclared<'a>(pub(crate) &'a Scenario);

impl Serialize for AsDeclared<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Scenario::serialize(self.0, serializer)
    }
}

impl<'de> Deserialize<'de> for Scenario {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let tree = <Value as Deserialize>::deserialize(deserializer)?;
        Self::from_json(tree).map_err(D::Error::custom)
    }
}

impl Serialize for Scenario {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let tree = serde_json::to_value(AsDeclared(self)).map_err(S::Error::custom)?;
        tree.serialize(serializer)
    }
}
