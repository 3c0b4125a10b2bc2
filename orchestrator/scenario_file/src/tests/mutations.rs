//! Nothing that is in a file or an argument makes the loader panic, and every refusal can be shown.

use proptest::prelude::*;

use super::*;

/// The tokens of a text: words, numbers, and each other character by itself.
fn tokens(text: &str) -> Vec<&str> {
    let is_word = |character: char| character.is_alphanumeric() || matches!(character, '_' | '.' | '-');
    let mut tokens = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let word = rest.find(|character| !is_word(character)).unwrap_or(rest.len());
        let (token, after) = rest.split_at(word.max(first.len_utf8()).min(rest.len()));
        tokens.push(token);
        rest = after;
    }
    tokens
}

/// A change of the tokens of a text.
#[derive(Clone, Debug)]
enum Mutation {
    Delete(usize),
    Duplicate(usize),
    Swap(usize, usize),
    Replace(usize, &'static str),
}

fn mutation() -> impl Strategy<Value = Mutation> {
    let hostile = prop::sample::select(vec![
        "nan",
        "inf",
        "-1",
        "0",
        "1e308",
        "1e999",
        "9999999999999999999999",
        "\"",
        "'''",
        "[",
        "]",
        "{",
        "}",
        "=",
        "\n",
        ".",
        "é",
        "\u{feff}",
        "\0",
        "true",
        "[[vehicle.change]]",
        "[controller]",
        "1979-05-27",
    ]);
    let place = any::<usize>;
    prop_oneof![
        place().prop_map(Mutation::Delete),
        place().prop_map(Mutation::Duplicate),
        (place(), place()).prop_map(|(a, b)| Mutation::Swap(a, b)),
        (place(), hostile).prop_map(|(place, token)| Mutation::Replace(place, token)),
    ]
}

fn mutated(text: &str, mutations: &[Mutation]) -> String {
    let mut tokens = tokens(text);
    for mutation in mutations {
        let count = tokens.len().max(1);
        match *mutation {
            _ if tokens.is_empty() => {}
            Mutation::Delete(place) => {
                tokens.remove(place % count);
            }
            Mutation::Duplicate(place) => tokens.insert(place % count, tokens[place % count]),
            Mutation::Swap(a, b) => tokens.swap(a % count, b % count),
            Mutation::Replace(place, token) => tokens[place % count] = token,
        }
    }
    tokens.concat()
}

/// A scenario without its comments, so that mutations meet what counts.
fn bare(text: &str) -> String {
    let code = text
        .lines()
        .map(|line| line.split('#').next().unwrap_or_default().trim_end());
    code.filter(|line| !line.is_empty())
        .flat_map(|line| [line, "\n"])
        .collect()
}

/// Loads a text and shows what comes of it in every way; a scenario that is accepted has no problems.
fn load_and_show(text: &str, sets: &[&str]) {
    match load_text(text, sets) {
        Ok(scenario) => assert_eq!(scenario.problems(), []),
        Err(error) => {
            assert!(narrated(&error).contains("diagnostic help"));
            assert!(format!("{error:#}").contains("; "));
            let mut shown = String::new();
            miette::GraphicalReportHandler::new_themed(miette::GraphicalTheme::none())
                .render_report(&mut shown, &error)
                .expect("the labels lie inside the source");
        }
    }
}

#[test]
fn tokens_make_up_the_text() {
    let text = fig1();
    assert_eq!(tokens(&text).concat(), text);
    assert_eq!(tokens("k1 = 4.0\n"), ["k1", " ", "=", " ", "4.0", "\n"]);
}

proptest! {
    #[test]
    fn no_mutation_of_a_scenario_makes_the_loader_panic(
        mutations in prop::collection::vec(mutation(), 1..6),
    ) {
        load_and_show(&mutated(&bare(&fig1()), &mutations), &[]);
        load_and_show(&mutated(&bare(LABORATORY), &mutations), &[]);
    }

    #[test]
    fn no_cut_of_a_scenario_makes_the_loader_panic(place in any::<prop::sample::Index>()) {
        let text = fig1();
        let end = text.floor_char_boundary(place.index(text.len()));
        load_and_show(&text[..end], &[]);
    }

    #[test]
    fn no_length_of_a_line_makes_the_loader_panic(
        character in prop::sample::select(vec!["1", " ", "é", "\u{202e}", "\t"]),
        length in 0..70_000_usize,
        place in any::<prop::sample::Index>(),
    ) {
        let line = format!("x{}", character.repeat(length));
        let (before, after) = line.split_at(line.floor_char_boundary(place.index(line.len())));
        load_and_show(&format!("# {line}\nseed = '{before}' ={after}\n# {line}"), &[]);
        load_and_show(&fig1(), &[&format!("seed='{before}' ={after}")]);
    }

    #[test]
    fn no_argument_makes_the_loader_panic(
        key in prop::sample::select(vec!["controller.k1", "vehicle.change.0.at", "vehicle.inertia", "path.curve", "duration", "seed"]),
        mutations in prop::collection::vec(mutation(), 1..4),
        value in prop::sample::select(vec!["1.5", "[1, 2, 3]", "{hover = {position = [0, 0, 1]}}", "word", "\"text\""]),
    ) {
        load_and_show(&fig1(), &[&mutated(&format!("{key}={value}"), &mutations)]);
    }

    #[test]
    fn no_text_at_all_makes_the_loader_panic(text in "\\PC{0,60}", argument in "\\PC{0,30}") {
        load_and_show(&text, &[]);
        load_and_show(&fig1(), &[&argument]);
    }
}
