//! The field's language: no word that the glossary retired, and pages that are easy to read and to compare.

use std::path::{Path, PathBuf};

/// Names that programs outside of this repository rely on, and the retired word in each.
const KEPT: [(&str, &str); 7] = [
    // Key of the control channel, which running services of an older program read.
    ("services/runtime/src/control.rs", "reborn"),
    ("docs/processes.md", "reborn"),
    ("docs/process_contract.md", "reborn"),
    // Name of the socket of a run: a newer orchestrator takes over flights of an older one.
    ("services/runtime/src/take_over.rs", "succession"),
    // Key of the restarts in summaries and snapshots of earlier versions.
    ("orchestrator/report/src/info/words.rs", "rebirths"),
    ("orchestrator/run_client/src/snapshot.rs", "rebirths"),
    ("CHANGELOG.md", "rebirths"),
];

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Texts that people read or write, with their paths from the repository's root.
fn texts() -> Vec<(String, String)> {
    let mut folders = vec![repository()];
    let mut texts = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            let is_left_out =
                ["target", "runs", "book", ".git", ".venv", "proptest-regressions"].contains(&name);
            if path.is_dir() {
                if !is_left_out {
                    folders.push(path);
                }
                continue;
            }
            let extension = path.extension().and_then(|extension| extension.to_str());
            if matches!(
                extension,
                Some("rs" | "md" | "toml" | "py" | "sh" | "html" | "js" | "css")
            ) {
                let from_root = path
                    .strip_prefix(repository())
                    .unwrap()
                    .to_str()
                    .unwrap()
                    .to_owned();
                texts.push((from_root, std::fs::read_to_string(&path).unwrap()));
            }
        }
    }
    texts.sort();
    assert!(texts.len() > 300, "only {} files", texts.len());
    texts
}

/// Words of the glossary's table of retired ones, in lower case.
fn retired() -> Vec<String> {
    let glossary = std::fs::read_to_string(repository().join("docs/glossary.md")).unwrap();
    let (_, table) = glossary.split_once("<!-- retired words -->").unwrap();
    let rows = table.lines().filter(|line| line.starts_with('|')).skip(2);
    let words = rows.flat_map(|row| {
        let cell = row
            .trim_matches('|')
            .split(" | ")
            .next()
            .expect("splits into one");
        cell.split(',')
            .map(|word| word.trim().to_owned())
            .collect::<Vec<_>>()
    });
    let words: Vec<_> = words.collect();
    assert!(words.len() > 20, "{words:?}");
    words
}

/// Returns whether a line has a word or phrase that is not a part of a longer name.
fn has(line: &str, word: &str) -> bool {
    let is_part = |character: char| character.is_alphanumeric() || character == '_';
    line.match_indices(word)
        .any(|(at, _)| !line[..at].ends_with(is_part) && !line[at + word.len()..].starts_with(is_part))
}

#[test]
fn no_text_uses_a_word_that_the_glossary_retired() {
    let retired = retired();
    let mut found = Vec::new();
    for (path, text) in texts() {
        if ["docs/glossary.md", "tests/language.rs"].contains(&path.as_str()) {
            continue;
        }
        for (number, line) in text.lines().enumerate() {
            let lower = line.to_lowercase();
            for word in retired.iter().filter(|word| has(&lower, word)) {
                if !KEPT.contains(&(path.as_str(), word.as_str())) {
                    found.push(format!("{path}:{}: {word}: {}", number + 1, line.trim()));
                }
            }
        }
    }
    assert!(found.is_empty(), "{} lines:\n{}", found.len(), found.join("\n"));
}

/// Verbs of people, which a short doc comment gives to a program, and words that stand for a person.
const OF_PEOPLE: [&str; 30] = [
    "tells",
    "told",
    "knows",
    "hears",
    "heard",
    "looks",
    "looks at",
    "sees",
    "wants",
    "believes",
    "believed",
    "remembers",
    "remembered",
    "forgets",
    "forgotten",
    "speaks",
    "says",
    "thinks",
    "learns",
    "notices",
    "born",
    "newborn",
    "who",
    "whom",
    "whoever",
    "nobody",
    "somebody",
    "people",
    "goes on",
    "takes note",
];

/// The text of a doc comment of one line, without those of records, which are a part of logs.
fn short_doc_comments(source: &str) -> Vec<(usize, &str)> {
    let mut is_in_record = false;
    let lines: Vec<_> = source.lines().collect();
    let is_doc = |at: usize| {
        lines
            .get(at)
            .is_some_and(|line| line.trim_start().starts_with("///"))
    };
    let mut found = Vec::new();
    for (at, line) in lines.iter().enumerate() {
        is_in_record = (is_in_record || line.ends_with("sample! {")) && *line != "}";
        let is_alone = is_doc(at) && !is_doc(at + 1) && (at == 0 || !is_doc(at - 1));
        if is_alone && !is_in_record {
            found.push((at + 1, line.trim_start().trim_start_matches("/// ")));
        }
    }
    found
}

#[test]
fn short_doc_comments_give_no_verbs_of_people_to_programs() {
    let mut found = Vec::new();
    for (path, text) in texts() {
        if !(path.contains("/src/") && path.ends_with(".rs")) {
            continue;
        }
        for (number, comment) in short_doc_comments(&text) {
            let lower = comment.to_lowercase();
            if comment.split_whitespace().count() < 10 {
                let words = OF_PEOPLE.iter().filter(|word| has(&lower, word));
                found.extend(words.map(|word| format!("{path}:{number}: {word}: {comment}")));
            }
        }
    }
    assert!(found.is_empty(), "{} lines:\n{}", found.len(), found.join("\n"));
}

/// Lines of a page that are prose: no code, table, comment or heading.
fn prose(page: &str) -> Vec<(usize, &str)> {
    let mut is_code = false;
    let lines = page.lines().enumerate().filter(|(_, line)| {
        let line = line.trim_start();
        is_code ^= line.starts_with("```");
        !is_code && !line.starts_with(['`', '|', '#', '<', '!'])
    });
    lines.map(|(number, line)| (number + 1, line.trim())).collect()
}

/// Returns whether a second sentence begins within a line.
fn has_two_sentences(line: &str) -> bool {
    // What ends with a point and is no sentence.
    const ABBREVIATIONS: [&str; 6] = ["Fig", "Figs", "Sec", "no", "vs", "e.g"];
    line.match_indices(". ").any(|(at, _)| {
        let before = line[..at].rsplit([' ', '(']).next().unwrap_or_default();
        let is_number = before.ends_with(|character: char| character.is_ascii_digit()) && at < 3;
        let begins = line[at + 2..].trim_start_matches(['*', '`', '[', '(', '"']);
        !ABBREVIATIONS.contains(&before) && !is_number && begins.starts_with(char::is_uppercase)
    })
}

#[test]
fn pages_have_one_sentence_a_line_and_none_that_begins_with_who() {
    let mut found = Vec::new();
    for (path, text) in texts() {
        if path != "README.md" && !(path.starts_with("docs/") && path.ends_with(".md")) {
            continue;
        }
        for (number, line) in prose(&text) {
            let first = line.trim_start_matches(['*', '-', ' ']);
            if has_two_sentences(line) || first.starts_with("Who") {
                found.push(format!("{path}:{number}: {line}"));
            }
        }
    }
    assert!(found.is_empty(), "{} lines:\n{}", found.len(), found.join("\n"));
}

/// Returns the widths of formats in a line that are no constants.
fn computed_widths(line: &str) -> Vec<&str> {
    let is_part = |character: char| character.is_alphanumeric() || character == '_';
    let mut found = Vec::new();
    for (sign, _) in line.match_indices('$') {
        let before = &line[..sign];
        let name = before
            .rfind(|character| !is_part(character))
            .map_or(0, |at| at + 1);
        let name_of_width = &before[name..];
        let Some(format) = before[..name].rsplit_once('{').map(|(_, format)| format) else {
            continue;
        };
        let is_format = format.contains(':') && !format.contains(['}', '"']);
        // A number of digits is stated in the code; a width often comes from a text.
        let is_precision = format.ends_with('.');
        let is_constant = name_of_width.chars().all(|character| !character.is_lowercase())
            && name_of_width.starts_with(char::is_alphabetic);
        if is_format && !is_precision && !is_constant && !name_of_width.is_empty() {
            found.push(name_of_width);
        }
    }
    found
}

/// A width of a format is at most 65,535, and a larger one panics: nothing is padded to a width that a text or a place in one
/// gives. `" ".repeat(n)` pads to any.
#[test]
fn no_format_has_a_computed_width() {
    assert_eq!(
        computed_widths(r#"format!("{VALUE:>width$}={value}")"#),
        ["width"]
    );
    assert_eq!(computed_widths(r#"format!(" {:>1$}", label, width)"#), ["1"]);
    assert_eq!(
        computed_widths(r#"format!("{:NAME$} {value:.digits$}", " service")"#),
        [""; 0]
    );
    let mut found = Vec::new();
    for (path, text) in texts() {
        if path == "tests/language.rs" || !path.ends_with(".rs") {
            continue;
        }
        for (number, line) in text.lines().enumerate() {
            for width in computed_widths(line) {
                found.push(format!("{path}:{}: {width}", number + 1));
            }
        }
    }
    assert!(found.is_empty(), "{} lines:\n{}", found.len(), found.join("\n"));
}
