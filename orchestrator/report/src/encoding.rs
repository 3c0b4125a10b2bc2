//! Encoding of the page's numbers: f32 in base 64.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// Encodes numbers as consecutive little-endian f32 in base 64.
pub(super) fn base64(numbers: &[f32]) -> String {
    let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    STANDARD.encode(bytes)
}

/// Encodes text in base 64.
pub(super) fn base64_text(text: &str) -> String {
    STANDARD.encode(text)
}

/// Decodes numbers as the page does.
#[cfg(test)]
pub(super) fn decoded(text: &str) -> Vec<f32> {
    let bytes = STANDARD.decode(text).unwrap();
    let (words, rest) = bytes.as_chunks();
    assert!(rest.is_empty());
    words.iter().map(|&word| f32::from_le_bytes(word)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_come_back_to_the_bit(numbers in proptest::collection::vec(any::<u32>(), 0..50)) {
            let numbers: Vec<f32> = numbers.into_iter().map(f32::from_bits).collect();
            let bits = |numbers: &[f32]| numbers.iter().map(|number| number.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&decoded(&base64(&numbers))), bits(&numbers));
        }
    }
}
