//! Output of external services, made safe for a terminal.

/// Longest quotation of what a program says, characters.
const QUOTATION: usize = 500;

/// Makes a program's message fit for a terminal: not too long, and without characters that control it.
pub(super) fn presentable(said: &str) -> String {
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
