//! Validation of argument values.

use std::borrow::Cow;

use crate::slips;

/// Reason why a value is refused, with the accepted values.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum ValueError {
    #[error("this is not a number")]
    NoNumber,
    /// The value violates a condition; the message names it.
    #[error("{0}")]
    Unfit(Cow<'static, str>),
    #[error("there is no such {what}; {there_is}")]
    Unknown {
        /// Kind of the named object.
        what: &'static str,
        /// The known names, as part of a sentence.
        there_is: String,
    },
}

impl ValueError {
    /// Returns the refusal of a value with a message.
    pub fn unfit(sentence: impl Into<Cow<'static, str>>) -> Self {
        Self::Unfit(sentence.into())
    }
}

/// Checks a name that is used in tables and as a file name.
///
/// # Errors
/// [`ValueError::Unfit`].
pub fn plain_name(name: &str) -> Result<(), ValueError> {
    let is_plain = |letter: char| letter.is_alphanumeric() || " ,.+-_()=".contains(letter);
    if name.is_empty() || name.starts_with(['.', ' ']) || !name.chars().all(is_plain) {
        return Err(ValueError::unfit(format!(
            "the name {name:?} is not valid for a file and a table: use letters, digits and blanks"
        )));
    }
    Ok(())
}

/// Returns a parser of numbers within inclusive limits.
pub fn between(
    least: f64,
    most: f64,
    unit: &'static str,
) -> impl Fn(&str) -> Result<f64, ValueError> + Clone + Send + Sync + 'static {
    move |text| {
        let value = number(text, unit)?;
        value_between(value, least, most, unit)
    }
}

/// Parses a number. A comma or a unit in it is named.
fn number(text: &str, unit: &str) -> Result<f64, ValueError> {
    text.parse().map_err(|_| match slips::advice(text, Some(unit)) {
        Some(advice) => ValueError::unfit(advice),
        None => ValueError::NoNumber,
    })
}

/// Returns a parser of whole numbers of `what` within inclusive limits.
pub fn count(
    least: u32,
    most: u32,
    what: &'static str,
) -> impl Fn(&str) -> Result<u32, ValueError> + Clone + Send + Sync + 'static {
    move |text| {
        let count = text.parse().ok().filter(|count| (least..=most).contains(count));
        count
            .ok_or_else(|| ValueError::unfit(format!("give a whole number of {what} from {least} to {most}")))
    }
}

/// Checks a number against inclusive limits.
///
/// # Errors
/// [`ValueError::Unfit`].
pub fn value_between(value: f64, least: f64, most: f64, unit: &str) -> Result<f64, ValueError> {
    if (least..=most).contains(&value) {
        Ok(value)
    } else {
        Err(ValueError::unfit(format!("give {least} to {most} {unit}")))
    }
}
