//! Messages of external services, made safe for a terminal.

/// Maximum length of a quoted message, characters.
const QUOTATION: usize = 500;

/// Truncates a program's message and replaces its control characters.
pub fn presentable(said: &str) -> String {
    let shown = said.chars().take(QUOTATION);
    let mut shown: String = shown
        .map(|character| {
            if character.is_control() {
                '\u{FFFD}'
            } else {
                character
            }
        })
        .collect();
    if said.chars().nth(QUOTATION).is_some() {
        shown.push('…');
    }
    shown
}
