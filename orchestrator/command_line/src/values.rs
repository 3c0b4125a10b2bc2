//! Values of arguments.

/// A number within limits.
///
/// # Errors
/// What to give instead.
pub fn number_between(text: &str, least: f64, most: f64, unit: &str) -> Result<f64, String> {
    let value = text.parse().map_err(|_| "this is no number".to_owned())?;
    value_between(value, least, most, unit)
}

/// A value within limits.
///
/// # Errors
/// What to give instead.
pub fn value_between(value: f64, least: f64, most: f64, unit: &str) -> Result<f64, String> {
    if (least..=most).contains(&value) {
        Ok(value)
    } else {
        Err(format!("give {least} to {most} {unit}"))
    }
}
