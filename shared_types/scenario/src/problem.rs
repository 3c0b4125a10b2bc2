//! Problems of a scenario: key, reason and fix.

use super::suggest;

/// Key of a value in a scenario: the names of tables and keys and the positions in arrays on the path to it.
///
/// Displayed as TOML writes it, such as `vehicle.change.0.at` or `schedule.latency."rc/frame -> plant"`.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Key {
    segments: Vec<String>,
}

impl Key {
    /// Returns the key of the scenario itself.
    #[must_use]
    pub fn root() -> Self {
        Self::default()
    }

    /// Returns the key of a name or position inside this one.
    #[must_use]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "names and positions stand as literals at the call"
    )]
    pub fn then(&self, segment: impl ToString) -> Self {
        let mut segments = self.segments.clone();
        segments.push(segment.to_string());
        Self { segments }
    }

    /// Returns the names and positions, outermost first.
    #[must_use]
    pub fn segments(&self) -> &[String] {
        &self.segments
    }

    /// Returns whether this key equals another one, or is a position in its value.
    pub(crate) fn is_element_of(&self, other: &Self) -> bool {
        let inside = self.segments.strip_prefix(other.segments.as_slice());
        let is_position = |segment: &String| segment.parse::<usize>().is_ok();
        inside.is_some_and(|inside| inside.iter().all(is_position))
    }

    /// Returns whether one of two keys equals or contains the other.
    #[must_use]
    pub fn overlaps(&self, other: &Self) -> bool {
        self.segments.starts_with(&other.segments) || other.segments.starts_with(&self.segments)
    }
}

impl<S: Into<String>> FromIterator<S> for Key {
    fn from_iter<I: IntoIterator<Item = S>>(segments: I) -> Self {
        Self {
            segments: segments.into_iter().map(Into::into).collect(),
        }
    }
}

impl std::fmt::Display for Key {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (index, segment) in self.segments.iter().enumerate() {
            if index > 0 {
                formatter.write_str(".")?;
            }
            if is_bare(segment) {
                formatter.write_str(segment)?;
            } else {
                write!(formatter, "{segment:?}")?;
            }
        }
        Ok(())
    }
}

/// Returns whether TOML accepts a key without quotes.
fn is_bare(segment: &str) -> bool {
    let bare = |character: char| character.is_ascii_alphanumeric() || matches!(character, '_' | '-');
    !segment.is_empty() && segment.chars().all(bare)
}

/// Problem of a scenario.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The key.
    pub key: Key,
    /// The reason.
    pub reason: String,
    /// The fix.
    pub fix: String,
}

impl Problem {
    /// Makes a problem of a key.
    #[must_use]
    pub fn new(key: Key, reason: impl Into<String>, fix: impl Into<String>) -> Self {
        Self {
            key,
            reason: reason.into(),
            fix: fix.into(),
        }
    }

    /// Makes the problem of an unknown name.
    #[must_use]
    pub(super) fn unknown_name(key: Key, name: &str, what: &str, known: &[String]) -> Self {
        Self::new(
            key,
            format!("there is no {what} `{name}`"),
            suggest::known_names(name, known),
        )
    }
}

impl std::fmt::Display for Problem {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "`{}`: {}; {}", self.key, self.reason, self.fix)
    }
}

impl std::error::Error for Problem {}

/// Error of a scenario without a valid schedule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unflyable(pub Vec<Problem>);

impl std::fmt::Display for Unflyable {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let problems: Vec<_> = self.0.iter().map(ToString::to_string).collect();
        formatter.write_str(&problems.join("; "))
    }
}

impl std::error::Error for Unflyable {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_displayed_as_toml_writes_it() {
        let key = Key::root()
            .then("schedule")
            .then("latency")
            .then("rc/frame -> plant");
        assert_eq!(key.to_string(), "schedule.latency.\"rc/frame -> plant\"");
        assert_eq!(
            Key::root().then("a.b").then("").then(3).to_string(),
            "\"a.b\".\"\".3"
        );
    }
}
