//! The documentation says what is so: numbers, messages, pictures, commands and links are compared with the program.
//!
//! A failure shows the text that belongs into the document.

mod common;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::Parser;
use command_line::exit::Exit;
use common::{Place, scenario, succeed};
use orchestrator::cli::Cli;
use run_log::{
    CaptureFigures, HostEvent, HostSample, LinkFigures, ServiceCheckpoint, ServiceHealth, ServiceStep,
};
use shared_types::sample::{Record, msg_definition};
use shared_types::{Header, Topic};

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

fn read(path: &str) -> String {
    std::fs::read_to_string(repository(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The README and the guides, with their text.
fn documents() -> Vec<(PathBuf, String)> {
    let guides = std::fs::read_dir(repository("docs")).unwrap();
    let mut paths: Vec<_> = guides.map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "md"));
    assert!(paths.len() >= 4, "{paths:?}");
    paths.push(repository("README.md"));
    let text = |path: &PathBuf| std::fs::read_to_string(path).unwrap();
    paths
        .into_iter()
        .map(|path| (path.clone(), text(&path)))
        .collect()
}

/// What stands between `<!-- name -->` and `<!-- end of … -->`.
fn section<'a>(document: &'a str, name: &str) -> &'a str {
    let begin = format!("<!-- {name} -->");
    let (_, rest) = document
        .split_once(&begin)
        .unwrap_or_else(|| panic!("no {begin}"));
    rest.split_once("<!-- end of").expect("a section ends").0.trim()
}

/// The content of all fenced blocks of a language.
fn blocks<'a>(document: &'a str, language: &str) -> Vec<&'a str> {
    let opening = format!("```{language}\n");
    let parts = document.split(&opening).skip(1);
    parts
        .map(|part| part.split_once("```").expect("a block ends").0)
        .collect()
}

/// The rows of a Markdown table, cell by cell, without its head.
fn rows(table: &str) -> Vec<Vec<&str>> {
    let lines = table.lines().filter(|line| line.starts_with('|')).skip(2);
    lines
        .map(|line| line.trim_matches('|').split(" | ").map(str::trim).collect())
        .collect()
}

fn assert_same(is: &str, should_be: &str, place: &str) {
    assert!(
        is.trim() == should_be.trim(),
        "{place} is out of date; it should be\n\n{should_be}"
    );
}

/// The words of a command line, as a shell splits them: quotes are single ones.
fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut is_quoted = false;
    for character in line.chars() {
        match character {
            '\'' => is_quoted = !is_quoted,
            ' ' if !is_quoted => words.push(String::new()),
            other => words.last_mut().expect("begins with one").push(other),
        }
    }
    words
}

fn topic_table() -> String {
    let mut table = String::from(
        "| topic | message | publisher | consumers | bytes |\n| --- | --- | --- | --- | --- |\n",
    );
    for topic in Topic::ALL {
        let publisher = topic.publisher().map_or("orchestrator", |service| service.name());
        let consumers: Vec<_> = topic.consumers().map(|(service, _)| service.name()).collect();
        table += &format!(
            "| `{topic}` | `{}` | {publisher} | {} | {} |\n",
            topic.msg_name(),
            consumers.join(", "),
            topic.kind().size
        );
    }
    table
}

fn message(channel: &str, name: &str, definition: &str) -> String {
    // The header, which every definition carries with it, is shown once.
    let own = definition.split(&"=".repeat(80)).next().expect("splits into one");
    format!("### {channel}: {name}\n\n```text\n{own}```\n\n")
}

fn run_messages() -> String {
    let header = message("every topic", Header::MSG_NAME, &msg_definition::<Header>());
    let messages = Topic::ALL.map(|topic| message(topic.name(), topic.msg_name(), &topic.msg_definition()));
    header + &messages.concat()
}

fn host_messages() -> String {
    fn of<T: HostSample>() -> String {
        message(T::CHANNEL, T::MSG_NAME, &msg_definition::<T>())
    }
    [
        of::<HostEvent>(),
        of::<ServiceHealth>(),
        of::<ServiceStep>(),
        of::<ServiceCheckpoint>(),
        of::<CaptureFigures>(),
        of::<LinkFigures>(),
    ]
    .concat()
}

#[test]
fn the_topics_and_their_messages_are_those_of_the_program() {
    let document = read("docs/topics.md");
    assert_same(
        section(&document, "topics"),
        &topic_table(),
        "the table of topics",
    );
    let expected = run_messages();
    assert_same(section(&document, "messages of run.mcap"), &expected, "run.mcap");
    let expected = host_messages();
    assert_same(
        section(&document, "messages of host.mcap"),
        &expected,
        "host.mcap",
    );
}

#[test]
fn the_picture_is_what_the_command_prints() {
    let fig1 = scenario("fig1");
    let place = Place::new();
    let mut command = place.gerono(&["check", fig1.to_str().unwrap(), "--mermaid"]);
    let printed = String::from_utf8(succeed(&mut command).stdout).unwrap();
    let readme = read("README.md");
    let pictures = blocks(&readme, "mermaid");
    assert_eq!(pictures.len(), 1);
    assert_same(pictures[0], &printed, "the picture in the README");
}

/// All of the summary but its first line, which tells the wall time, is a function of the scenario.
#[test]
fn the_summary_and_the_digest_in_the_readme_are_those_of_fig_1() {
    let place = Place::new();
    let fig1 = scenario("fig1");
    let arguments = [
        "run",
        fig1.to_str().unwrap(),
        "--host",
        "inprocess",
        "--out",
        "out",
    ];
    let printed = String::from_utf8(succeed(&mut place.gerono(&arguments)).stdout).unwrap();
    let (_, printed) = printed.split_once('\n').unwrap();
    let (printed, _) = printed.split_once("results:").unwrap();
    let readme = read("README.md");
    let shown = blocks(section(&readme, "summary: fig1"), "text")[0];
    assert_same(
        shown.split_once('\n').unwrap().1,
        printed,
        "the summary in the README",
    );

    let digest = succeed(&mut place.gerono(&["digest", "out"])).stdout;
    let digest = String::from_utf8(digest).unwrap();
    assert!(readme.contains(digest.trim()), "the digest of Fig. 1 is {digest}");
}

#[test]
fn the_values_that_complete_the_paper_are_those_of_the_first_scenario() {
    let fig1 = scenario_file::load(&scenario("fig1"), &[], None).unwrap();
    let flown = serde_json::to_value(fig1).unwrap();
    let document = read("docs/deviations.md");
    let rows = rows(section(&document, "values: fig1"));
    assert!(rows.len() >= 10, "{rows:?}");
    for row in rows {
        let [key, value] = [row[0], row[1]].map(|cell| cell.trim_matches('`'));
        let stated: serde_json::Value = serde_json::from_str(value).unwrap();
        let pointer = format!("/{}", key.replace('.', "/"));
        assert_eq!(flown.pointer(&pointer), Some(&stated), "{key}");
    }
}

#[test]
fn every_command_shown_is_one_that_the_program_takes() {
    let mut count = 0;
    for (path, text) in documents() {
        for line in blocks(&text, "console").into_iter().flat_map(str::lines) {
            let Some(arguments) = line
                .strip_prefix("$ cargo run --release -- ")
                .or_else(|| line.strip_prefix("$ gerono "))
            else {
                continue;
            };
            let mut arguments = words(arguments);
            arguments.insert(0, "gerono".to_owned());
            if let Err(error) = Cli::try_parse_from(&arguments) {
                panic!("{}: {line}\n{error}", path.display());
            }
            count += 1;
        }
    }
    assert!(count >= 15, "only {count} commands were found");
}

#[test]
fn the_exit_codes_in_the_readme_are_those_of_the_help() {
    let numbers = |text: &str| -> BTreeSet<u32> {
        let words = text.split(|character: char| !character.is_ascii_digit());
        words.filter_map(|word| word.parse().ok()).collect()
    };
    let readme = read("README.md");
    let (_, table) = readme.split_once("## Exit codes").unwrap();
    let (table, _) = table.split_once("\n## ").unwrap();
    let codes: Vec<_> = rows(table).into_iter().map(|row| row[0]).collect();
    assert_eq!(numbers(&codes.join(" ")), numbers(Exit::HELP));
}

#[test]
fn every_crate_has_its_line_in_the_maps() {
    let manifest: toml::Table = read("Cargo.toml").parse().unwrap();
    let members = manifest["workspace"]["members"].as_array().unwrap();
    for document in ["README.md", "docs/architecture.md"] {
        let text = read(document);
        for member in members.iter().filter_map(toml::Value::as_str) {
            let line = format!("\n| `{member}` | ");
            assert_eq!(text.matches(&line).count(), 1, "{member} in {document}");
        }
    }
}

#[test]
fn every_link_inside_the_repository_leads_somewhere() {
    let mut count = 0;
    for (path, text) in documents() {
        for rest in text.split("](").skip(1) {
            let target = rest.split(')').next().expect("splits into one");
            let file = target.split('#').next().expect("splits into one");
            if file.is_empty() || file.contains("://") {
                continue;
            }
            let place = path.parent().unwrap().join(file);
            assert!(place.exists(), "{}: {target}", path.display());
            count += 1;
        }
    }
    assert!(count >= 10, "only {count} links were found");
}
