//! Suggestions for misspelt names.

/// Minimum length of a prefix by which a name is recognised.
const MIN_PREFIX: usize = 3;

/// Returns the known name closest to `name`, if one is close enough: at most a third of its letters, or one, differ, or it
/// is a prefix of the known name.
#[must_use]
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let length = name.chars().count();
    let limit = (length / 3).max(1);
    let is_prefix = |candidate: &str| length >= MIN_PREFIX && candidate.starts_with(name);
    known
        .into_iter()
        .map(|candidate| (strsim::osa_distance(name, candidate), candidate))
        .filter(|&(distance, candidate)| distance <= limit || is_prefix(candidate))
        .min()
        .map(|(_, candidate)| candidate)
}

/// Returns advice for an unknown name.
#[must_use]
pub fn known_names<S: AsRef<str>>(name: &str, known: &[S]) -> String {
    let known: Vec<&str> = known.iter().map(AsRef::as_ref).collect();
    let list = known
        .iter()
        .map(|name| format!("`{name}`"))
        .collect::<Vec<_>>()
        .join(", ");
    match nearest(name, known) {
        Some(nearest) => format!("did you mean `{nearest}`? Known are: {list}"),
        None => format!("known are: {list}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_name_is_recognised_and_a_foreign_one_is_not() {
        let known = ["sigma_max", "lambda_mass", "k1"];
        assert_eq!(nearest("sigmamax", known), Some("sigma_max"));
        assert_eq!(nearest("sigma_mxa", known), Some("sigma_max"));
        assert_eq!(nearest("k5", known), Some("k1"));
        assert_eq!(nearest("sigma", known), Some("sigma_max"));
        assert_eq!(nearest("colour", known), None);
    }
}
