//! Values of arguments.

use std::borrow::Cow;

/// Reason why a value is refused, and what to give instead.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum ValueError {
    /// It is no number.
    #[error("this is no number")]
    NoNumber,
    /// It is not what it must be; these are the words for it.
    #[error("{0}")]
    Unfit(Cow<'static, str>),
    /// It names nothing that there is.
    #[error("there is no such {what}; {there_is}")]
    Unknown {
        /// The kind of thing that has this name.
        what: &'static str,
        /// The names that exist instead, in words.
        there_is: String,
    },
}

impl ValueError {
    /// Refuses a value with a sentence.
    pub fn unfit(sentence: impl Into<Cow<'static, str>>) -> Self {
        Self::Unfit(sentence.into())
    }
}

/// Checks a name that stands in tables and makes names of files.
///
/// # Errors
/// [`ValueError::Unfit`].
pub fn plain_name(name: &str) -> Result<(), ValueError> {
    let is_plain = |letter: char| letter.is_alphanumeric() || " ,.+-_()=".contains(letter);
    if name.is_empty() || name.starts_with(['.', ' ']) || !name.chars().all(is_plain) {
        return Err(ValueError::unfit(format!(
            "its name {name:?} cannot be that of a file and stand in a table: use letters, digits and blanks"
        )));
    }
    Ok(())
}

/// Parses numbers within limits.
pub fn between(
    least: f64,
    most: f64,
    unit: &'static str,
) -> impl Fn(&str) -> Result<f64, ValueError> + Clone + Send + Sync + 'static {
    move |text| {
        let value = text.parse().map_err(|_| ValueError::NoNumber)?;
        value_between(value, least, most, unit)
    }
}

/// A value within limits.
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
