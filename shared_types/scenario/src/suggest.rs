//! What a misspelt name may have been meant to be.

/// Least length of a beginning by which a name is recognised.
const LEAST_BEGINNING: usize = 3;

/// The known name that is nearest to `name`, if any is near enough to be meant: at most a third of it, or
/// one letter, has to change, or it is the known one's beginning.
#[must_use]
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let length = name.chars().count();
    let limit = (length / 3).max(1);
    let begins = |candidate: &str| length >= LEAST_BEGINNING && candidate.starts_with(name);
    known
        .into_iter()
        .map(|candidate| (edit_distance(name, candidate), candidate))
        .filter(|&(distance, candidate)| distance <= limit || begins(candidate))
        .min()
        .map(|(_, candidate)| candidate)
}

/// Advice for a name that is not among the known ones.
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

/// How many letters must be inserted, removed, replaced or swapped with their neighbour to turn `a` into `b`
/// (optimal string alignment).
fn edit_distance(a: &str, b: &str) -> usize {
    let a: Vec<char> = a.chars().collect();
    let b: Vec<char> = b.chars().collect();
    // distance[i][j] is that of the first i letters of a and the first j of b.
    let mut distance = vec![vec![0; b.len() + 1]; a.len() + 1];
    for i in 0..=a.len() {
        for j in 0..=b.len() {
            distance[i][j] = if i == 0 || j == 0 {
                i + j
            } else {
                let replaced = distance[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
                let inserted_or_removed = distance[i - 1][j].min(distance[i][j - 1]) + 1;
                let swapped = if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                    distance[i - 2][j - 2] + 1
                } else {
                    usize::MAX
                };
                replaced.min(inserted_or_removed).min(swapped)
            };
        }
    }
    distance[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_distance_is_symmetric_and_zero_only_for_equals(a in "[abc]{0,6}", b in "[abc]{0,6}") {
            prop_assert_eq!(edit_distance(&a, &b), edit_distance(&b, &a));
            prop_assert_eq!(edit_distance(&a, &b) == 0, a == b);
        }

        #[test]
        fn one_removed_letter_is_one_edit(a in "[a-z]{1,8}", place in 0..8usize) {
            let place = place % a.len();
            let shorter = format!("{}{}", &a[..place], &a[place + 1..]);
            prop_assert_eq!(edit_distance(&a, &shorter), 1);
        }
    }

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
