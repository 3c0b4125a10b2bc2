//! The documentation says what is so: numbers, messages, pictures, commands and links are compared with the program.
//!
//! A failure shows the text that belongs into the document; with `GERONO_BLESS=1` in the environment it is written there.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use clap::{CommandFactory, Parser};
use common::{Place, scenario, succeed};
use orchestrator::cli::Cli;
use run_log::{
    CaptureFigures, HostEvent, HostSample, LinkFigures, ServiceCheckpoint, ServiceHealth, ServiceStep,
};
use serde_json::Value;
use shared_types::sample::{self, Record, msg_definition};
use shared_types::{Header, Topic};

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

pub(crate) fn read(path: &str) -> String {
    std::fs::read_to_string(repository(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The Markdown files of a folder, with their text.
fn markdown_in(folder: &Path) -> Vec<(PathBuf, String)> {
    let entries = std::fs::read_dir(folder).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    paths
        .filter(|path| path.extension().is_some_and(|extension| extension == "md"))
        .map(|path| (path.clone(), std::fs::read_to_string(path).unwrap()))
        .collect()
}

/// The pages of the manual.
fn pages() -> Vec<(PathBuf, String)> {
    let mut pages = markdown_in(&repository("docs"));
    pages.retain(|(path, _)| !path.ends_with("SUMMARY.md"));
    assert!(pages.len() >= 40, "{}", pages.len());
    pages
}

/// The manual, what stands beside it at the root, the forms of the forge, and the examples.
fn documents() -> Vec<(PathBuf, String)> {
    let examples = std::fs::read_dir(repository("examples")).unwrap();
    let mut folders: Vec<_> = examples.map(|entry| entry.unwrap().path()).collect();
    folders.retain(|path| path.is_dir());
    folders.extend(["docs", ".", ".github/ISSUE_TEMPLATE"].map(repository));
    folders.iter().flat_map(|folder| markdown_in(folder)).collect()
}

/// Returns the text between `<!-- name -->` and `<!-- end of … -->`.
pub(crate) fn section<'a>(document: &'a str, name: &str) -> &'a str {
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

/// A piece of a document is what it should be, or is made so on request.
pub(crate) fn assert_same(document: &str, is: &str, should_be: &str) {
    if is.trim() == should_be.trim() {
        return;
    }
    assert!(
        std::env::var_os("GERONO_BLESS").is_some(),
        "{document} is out of date: set GERONO_BLESS=1 to write\n\n{should_be}"
    );
    assert!(
        !is.trim().is_empty(),
        "{document}: write any line where it is to be"
    );
    let text = read(document).replacen(is.trim(), should_be.trim(), 1);
    std::fs::write(repository(document), text).unwrap();
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

fn message(channel: &str, name: &str, definition: &str, members: &[sample::Member]) -> String {
    // The header, which every definition carries with it, is shown once.
    let own = definition.split(&"=".repeat(80)).next().expect("splits into one");
    let mut text = format!("### {channel}: {name}\n\n```text\n");
    for line in own.lines() {
        match members
            .iter()
            .find(|member| line.ends_with(&format!(" {}", member.name)))
        {
            Some(member) => text += &format!("{line:<36} # {}\n", member.meaning),
            None => text += &format!("{line}\n"),
        }
    }
    text + "```\n\n"
}

fn run_messages() -> String {
    let header = message(
        "every topic",
        Header::MSG_NAME,
        &msg_definition::<Header>(),
        &Header::members(),
    );
    let messages = Topic::ALL.map(|topic| {
        message(
            topic.name(),
            topic.msg_name(),
            &topic.msg_definition(),
            &topic.members(),
        )
    });
    header + &messages.concat()
}

fn host_messages() -> String {
    fn of<T: HostSample>() -> String {
        message(T::CHANNEL, T::MSG_NAME, &msg_definition::<T>(), &T::members())
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
    let generated = [
        ("topics", topic_table()),
        ("messages of run.mcap", run_messages()),
        ("messages of host.mcap", host_messages()),
    ];
    for (name, text) in generated {
        assert_same("docs/topics.md", section(&document, name), &text);
    }
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
    assert_same("README.md", pictures[0], &printed);
}

/// Flies a scenario, and compares the summary in a document with the printed one. All of it but the first line, which
/// tells the wall time, is a function of the scenario.
fn assert_summary(place: &Place, name: &str, document: &str) {
    let scenario = scenario(name);
    let path = scenario.to_str().unwrap();
    let arguments = ["run", path, "--host", "inprocess", "--out", "out"];
    let printed = String::from_utf8(succeed(&mut place.gerono(&arguments)).stdout).unwrap();
    let (_, printed) = printed.split_once("completed").unwrap();
    let (printed, _) = printed.split_once("results:").unwrap();
    let text = read(document);
    let shown = blocks(section(&text, &format!("summary: {name}")), "text")[0];
    let (_, shown) = shown.split_once('\n').unwrap();
    assert_same(document, shown, &format!("completed{printed}"));
}

#[test]
fn the_flight_of_another_vehicle_is_as_its_page_says() {
    assert_summary(&Place::new(), "another_vehicle", "docs/another_vehicle.md");
}

#[test]
fn the_rules_of_tuning_are_those_of_the_program() {
    let document = read("docs/tuning.md");
    assert_same(
        "docs/tuning.md",
        section(&document, "rules"),
        &scenario_file::gain_rules::table(),
    );
}

#[test]
fn the_summary_and_the_digest_in_the_readme_are_those_of_fig_1() {
    let place = Place::new();
    assert_summary(&place, "fig1", "README.md");
    let readme = read("README.md");

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
        let stated: Value = serde_json::from_str(value).unwrap();
        let pointer = format!("/{}", key.replace('.', "/"));
        assert_eq!(flown.pointer(&pointer), Some(&stated), "{key}");
    }
}

#[test]
fn every_command_shown_is_one_that_the_program_takes() {
    let mut count = 0;
    let mut check = |place: &Path, command: &str| {
        let mut arguments = words(command);
        arguments.insert(0, "gerono".to_owned());
        if let Err(error) = Cli::try_parse_from(&arguments) {
            panic!("{}: {command}\n{error}", place.display());
        }
        count += 1;
    };
    for (path, text) in documents() {
        for line in blocks(&text, "console").into_iter().flat_map(str::lines) {
            let arguments = line
                .strip_prefix("$ cargo run --release -- ")
                .or_else(|| line.strip_prefix("$ gerono "));
            if let Some(arguments) = arguments {
                check(
                    &path,
                    arguments
                        .split_once(" > ")
                        .map_or(arguments, |(command, _)| command),
                );
            }
        }
    }
    for path in scenario_files() {
        let text = std::fs::read_to_string(&path).unwrap();
        // A command in a comment may have a note behind four spaces, and go on in the next line.
        let comments = text.replace("\\\n#", "");
        for line in comments.lines() {
            if let Some((_, command)) = line
                .strip_prefix("#  ")
                .and_then(|line| line.split_once(" gerono "))
            {
                check(
                    &path,
                    command.split("    ").next().expect("splits into one").trim_end(),
                );
            }
        }
    }
    assert!(count >= 40, "only {count} commands were found");
}

/// The scenarios and sweeps of the repository.
fn scenario_files() -> Vec<PathBuf> {
    let listed = ["scenarios", "scenarios/sweeps"].map(|folder| repository(folder).read_dir().unwrap());
    let paths = listed.into_iter().flatten().map(|entry| entry.unwrap().path());
    let files = paths.filter(|path| path.extension().is_some_and(|ending| ending == "toml"));
    files.collect()
}

/// What a document names between backticks, outside of fenced blocks.
fn code_spans(text: &str) -> Vec<&str> {
    let mut is_code = false;
    let lines = text.lines().filter(|line| {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        !is_code && !is_fence
    });
    lines
        .flat_map(|line| line.split('`').skip(1).step_by(2))
        .collect()
}

/// Returns whether a name is that of a program of tests.
fn is_test(name: &str, members: &BTreeMap<String, Member>) -> bool {
    let folders = members.values().map(|member| repository(&member.folder));
    let mut folders = folders.chain([repository("")]);
    folders.any(|folder| {
        let tests = folder.join("tests");
        let [program, module] = [tests.join(name), tests.join("it").join(name)];
        program.join("main.rs").exists()
            || [program, module]
                .iter()
                .any(|file| file.with_extension("rs").exists())
    })
}

/// Returns whether a text between backticks is a command, or why none like it exists.
fn check_command(
    span: &str,
    gerono: &clap::Command,
    members: &BTreeMap<String, Member>,
) -> Result<bool, String> {
    let exists = |is_there: bool, reason: &str| is_there.then_some(true).ok_or(reason.to_owned());
    match span.split(' ').collect::<Vec<_>>()[..] {
        ["gerono", name, ..] if name.starts_with(|first: char| first.is_ascii_lowercase()) => {
            exists(gerono.find_subcommand(name).is_some(), "no such command")
        }
        ["cargo", "run", "--release", "--", _, ..] => {
            // The dashes stand in the place of the program's name.
            let arguments = words(span).into_iter().skip(3);
            let parsed = Cli::try_parse_from(arguments);
            parsed.map(|_| true).map_err(|error| error.to_string())
        }
        ["cargo", "test", ref arguments @ ..] => {
            let value_of = |option| {
                let mut pairs = arguments.windows(2);
                pairs.find(|pair| pair[0] == option).map(|pair| pair[1])
            };
            let is_crate = value_of("-p").is_none_or(|name| members.contains_key(name));
            let modules = arguments.iter().filter_map(|word| word.strip_suffix("::"));
            let mut tests = value_of("--test").into_iter().chain(modules);
            let is_there = is_crate && tests.all(|name| is_test(name, members));
            exists(is_there, "no such crate or tests")
        }
        [script @ (".ci/run" | ".ci/full"), step] if !step.starts_with('-') => {
            let is_there = read(script).contains(&format!("{step}() {{"));
            exists(is_there, "no such step")
        }
        _ => Ok(false),
    }
}

#[test]
fn every_command_named_in_a_sentence_exists() {
    let mut gerono = Cli::command();
    gerono.build();
    let members = workspace();
    let mut count = 0;
    for (path, text) in documents() {
        for span in code_spans(&text) {
            match check_command(span, &gerono, &members) {
                Ok(is_command) => count += usize::from(is_command),
                Err(reason) => panic!("{}: `{span}`: {reason}", path.display()),
            }
        }
    }
    assert!(count >= 100, "only {count} commands were found");
}

/// Folders at the root with which the paths in documents begin.
const FOLDERS: [&str; 10] = [
    ".ci",
    "docs",
    "examples",
    "orchestrator",
    "packaging",
    "python",
    "scenarios",
    "services",
    "shared_types",
    "tests",
];

#[test]
fn every_file_named_in_a_sentence_exists() {
    let mut count = 0;
    for (path, text) in documents() {
        // Links have a test of their own, and their texts may be short.
        let text = text.replace("[`", "[").replace("`](", "](");
        for span in code_spans(&text) {
            let begins = FOLDERS.iter().any(|folder| {
                let rest = span.strip_prefix(folder);
                rest.is_some_and(|rest| rest.starts_with('/'))
            });
            if begins && !span.contains([' ', '*', '…', '<', '=']) {
                let is_there = repository(span.trim_end_matches('/')).exists();
                assert!(is_there, "{}: `{span}` is not there", path.display());
                count += 1;
            }
        }
    }
    assert!(count >= 50, "only {count} files were found");
}

/// Returns how many words of a page are read: those of sentences and of tables written by hand. Code, and what stands
/// between comments because the program generates it or a test compares it, is looked up instead.
fn words_to_read(page: &str) -> usize {
    let mut is_code = false;
    let mut is_generated = false;
    let mut words = 0;
    for line in page.lines().map(str::trim) {
        let is_fence = line.starts_with("```");
        is_code ^= is_fence;
        if line.starts_with("<!--") {
            is_generated = !line.starts_with("<!-- end of");
        } else if !is_code && !is_generated && !is_fence {
            let has_letters = |word: &&str| word.contains(char::is_alphanumeric);
            words += line.split_whitespace().filter(has_letters).count();
        }
    }
    assert!(!is_generated, "a comment has no end");
    words
}

#[test]
fn a_page_is_read_in_ten_minutes() {
    const WORDS_A_MINUTE: usize = 240;
    let example = "# Two words\n\n| a | 1 cm |\n```toml\nno = 1\n```\n<!-- keys: x -->\n```text\nno\n```\n<!-- end of keys -->\nsix\n";
    assert_eq!(words_to_read(example), 6);
    let documents = pages().into_iter().chain(markdown_in(&repository(".")));
    // A changelog is searched, and not read.
    let documents = documents.filter(|(path, _)| !path.ends_with("CHANGELOG.md"));
    let minutes = documents.map(|(path, text)| (path, words_to_read(&text).div_ceil(WORDS_A_MINUTE)));
    let long: Vec<_> = minutes.filter(|(_, minutes)| *minutes > 10).collect();
    assert!(long.is_empty(), "minutes of reading: {long:?}");
}

/// Reading orders, each with the largest number of words of its pages together, code and tables included.
const READING_ORDERS: [(&str, usize); 2] = [
    ("docs/for_researchers.md", 9000),
    ("docs/for_laboratories.md", 12_000),
];

#[test]
fn a_reading_order_states_the_words_of_its_pages_and_keeps_its_limit() {
    let words_in = |page: &str| read(page).split_whitespace().count();
    for (order, limit) in READING_ORDERS {
        let document = read(order);
        let rows = rows(section(&document, "reading order"));
        assert!(rows.len() >= 5, "{order}: {rows:?}");
        let mut sum = words_in(order);
        for row in rows {
            let (_, file) = row[0].split_once("](").expect("a link");
            let page = format!("docs/{}", file.trim_end_matches(')'));
            let words = words_in(&page);
            let stated: usize = row[2].parse().unwrap();
            assert!(stated.abs_diff(words) <= 100, "{order}: {page} has {words} words");
            sum += words;
        }
        assert!(sum <= limit, "{order}: {sum} words, more than {limit}");
    }
}

#[test]
fn the_pages_of_commands_and_exit_codes_are_those_of_the_program() {
    let (help, codes) = orchestrator::manual::pages::commands(orchestrator::cli::groups::command());
    let pages = [
        ("docs/commands.md", "commands", help),
        ("docs/exit_codes.md", "exit codes", codes),
    ];
    for (page, name, text) in pages {
        assert_same(page, section(&read(page), name), &text);
    }
}

#[test]
fn a_shell_is_offered_scenarios_keys_and_topics() {
    let place = Place::new();
    std::fs::write(place.path("mine.toml"), "").unwrap();
    std::fs::write(place.path("notes.txt"), "").unwrap();
    let offered = |words: &[&str]| {
        let mut command = place.gerono(&["--", "gerono"]);
        command.args(words).env("COMPLETE", "fish");
        String::from_utf8(succeed(&mut command).stdout).unwrap()
    };
    assert_eq!(offered(&["run", "m"]), "mine.toml\n");
    let keys = offered(&["run", "mine.toml", "--set", "controller.k"]);
    assert_eq!(keys.lines().count(), 3, "{keys}");
    assert!(keys.starts_with("controller.k1=\t"), "{keys}");
    assert!(offered(&["export", "run", "--topic", "vehicle/t"]).contains("vehicle/truth"));
}

/// A crate of the workspace: its folder, and the crates of the workspace that it uses, tests aside.
struct Member {
    folder: String,
    uses: BTreeSet<String>,
}

/// The crates of the workspace by name, as Cargo knows them.
fn workspace() -> BTreeMap<String, Member> {
    let mut cargo = Command::new(env!("CARGO"));
    cargo
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(repository(""));
    let metadata: Value = serde_json::from_slice(&succeed(&mut cargo).stdout).unwrap();
    let root = metadata["workspace_root"].as_str().unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let name_of = |value: &Value| value["name"].as_str().unwrap().to_owned();
    let names: BTreeSet<_> = packages.iter().map(name_of).collect();
    let member = |package: &Value| {
        let manifest = Path::new(package["manifest_path"].as_str().unwrap());
        let folder = manifest.parent().unwrap().strip_prefix(root).unwrap();
        let dependencies = package["dependencies"].as_array().unwrap().iter();
        Member {
            folder: folder.to_str().unwrap().to_owned(),
            uses: dependencies
                .filter(|dependency| dependency["kind"].is_null())
                .map(name_of)
                .filter(|name| names.contains(name))
                .collect(),
        }
    };
    packages
        .iter()
        .map(|package| (name_of(package), member(package)))
        .collect()
}

#[test]
fn crates_use_what_the_architecture_lists_and_nothing_else() {
    let document = read("docs/architecture.md");
    let listed: BTreeMap<_, BTreeSet<_>> = rows(section(&document, "crates"))
        .iter()
        .map(|row| {
            let used = row[2].split(", ").filter(|name| *name != "–");
            (
                row[0].trim_matches('`').to_owned(),
                used.map(str::to_owned).collect(),
            )
        })
        .collect();
    let members = workspace().into_values();
    let used: BTreeMap<_, _> = members.map(|member| (member.folder, member.uses)).collect();
    assert!(used.len() >= 20, "{used:?}");
    assert_eq!(
        used, listed,
        "what Cargo knows, and the table in docs/architecture.md"
    );
}

/// All that a crate uses, and all that those use.
fn below(members: &BTreeMap<String, Member>, name: &str) -> BTreeSet<String> {
    let used = members[name].uses.iter();
    used.flat_map(|used| below(members, used).into_iter().chain([used.clone()]))
        .collect()
}

/// What only the machine half may reach.
const OF_MACHINE: [&str; 9] = [
    "iceoryx2",
    "clap",
    "console",
    "crossterm",
    "indicatif",
    "ratatui",
    "signal-hook",
    "terminal_size",
    "command_line",
];

/// Returns the packages that Cargo builds for crates, down to a depth below them.
fn packages_below<'a>(crates: impl IntoIterator<Item = &'a str>, depth: &str) -> BTreeSet<String> {
    let mut cargo = Command::new(env!("CARGO"));
    let form = [
        "--edges", "normal", "--prefix", "none", "--format", "{lib}", "--depth", depth,
    ];
    cargo
        .args(["tree", "--offline"])
        .args(form)
        .args(crates.into_iter().flat_map(|name| ["--package", name]))
        .current_dir(repository(""));
    let printed = String::from_utf8(succeed(&mut cargo).stdout).unwrap();
    let names = printed.lines().filter_map(|line| line.split_whitespace().next());
    names.map(|name| name.replace('_', "-")).collect()
}

#[test]
fn the_pure_half_reaches_no_machine() {
    let document = read("docs/architecture.md");
    let pure: Vec<_> = section(&document, "pure half")
        .split('`')
        .skip(1)
        .step_by(2)
        .collect();
    assert!(pure.len() >= 17, "{pure:?}");
    let below = packages_below(pure.iter().copied(), "999");
    assert!(below.len() > 40, "{below:?}");
    let of_machine: Vec<_> = OF_MACHINE
        .iter()
        .filter(|name| below.contains(&name.replace('_', "-")))
        .collect();
    assert!(of_machine.is_empty(), "the pure half reaches {of_machine:?}");
    // Packages of others may call the system.
    for name in pure.iter().filter(|name| **name != "result_file") {
        let direct = packages_below([*name], "1");
        assert!(!direct.contains("rustix") && !direct.contains("libc"), "{name}");
    }
    // What is forbidden is there to be found.
    let of_all = packages_below(["orchestrator"], "999");
    assert!(
        OF_MACHINE
            .iter()
            .all(|name| of_all.contains(&name.replace('_', "-")))
    );
}

#[test]
fn the_picture_of_the_crates_is_what_cargo_knows() {
    let members = workspace();
    let mut picture = "```mermaid\nflowchart BT\n".to_owned();
    for (name, member) in &members {
        for used in &member.uses {
            let mut others = member.uses.iter().filter(|other| *other != used);
            if !others.any(|other| below(&members, other).contains(used)) {
                picture += &format!("    {used} --> {name}\n");
            }
        }
    }
    picture += "```";
    let document = read("docs/architecture.md");
    assert_same(
        "docs/architecture.md",
        section(&document, "picture of the crates"),
        &picture,
    );
}

/// Lines of Rust in a folder, folders of other crates left out.
fn lines_in(folder: &Path) -> usize {
    let entries = std::fs::read_dir(folder).unwrap();
    let lines = entries.map(|entry| {
        let path = entry.unwrap().path();
        if path.is_dir() && !path.join("Cargo.toml").exists() {
            lines_in(&path)
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            std::fs::read_to_string(&path).unwrap().lines().count()
        } else {
            0
        }
    });
    lines.sum()
}

#[test]
fn no_crate_holds_half_of_the_house() {
    for member in workspace().into_values() {
        let lines = lines_in(&repository(&member.folder));
        let most = match member.folder.as_str() {
            "orchestrator" => 5500,
            // The verdict on a flight: each of its rules has a test.
            "orchestrator/metrics" => 8600,
            "orchestrator/run_log" => 8760,
            "services/runtime" => 8730,
            // The parameters of everything with their checks, and a test for each of them: a third of it is tests.
            "shared_types/scenario" => 12_930,
            _ => 8500,
        };
        assert!((1..=most).contains(&lines), "{}: {lines} lines", member.folder);
    }
}

/// The anchor of a heading, as forges and mdBook make it.
fn anchor(heading: &str) -> String {
    let kept = |character: &char| character.is_alphanumeric() || matches!(character, ' ' | '-' | '_');
    let text: String = heading.chars().filter(kept).collect();
    text.trim().to_lowercase().replace(' ', "-")
}

/// The anchors of a page.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut is_code = false;
    let headings = text.lines().filter(|line| {
        is_code ^= line.starts_with("```");
        !is_code && line.starts_with('#')
    });
    headings
        .map(|line| anchor(line.trim_start_matches('#')))
        .collect()
}

/// The help of all commands is for searching, and no page of the book.
#[test]
fn the_manual_lists_every_page_once() {
    let summary = read("docs/SUMMARY.md");
    let listed: Vec<_> = summary
        .split("](")
        .skip(1)
        .map(|rest| rest.split(')').next().unwrap().to_owned())
        .collect();
    let pages: BTreeSet<_> = pages()
        .into_iter()
        .map(|(path, _)| path.file_name().unwrap().to_str().unwrap().to_owned())
        .filter(|name| name != "commands.md")
        .collect();
    assert_eq!(listed.len(), pages.len());
    assert_eq!(listed.into_iter().collect::<BTreeSet<_>>(), pages);
}

/// mdBook takes every link to Markdown for one to a page of the book.
#[test]
fn the_manual_links_to_its_own_pages_only() {
    for (path, text) in pages() {
        for rest in text.split("](").skip(1) {
            let target = rest.split([')', '#']).next().expect("splits into one");
            let is_outside = target.starts_with("../") && target.ends_with(".md");
            assert!(!is_outside, "{}: {target}", path.display());
        }
    }
}

#[test]
fn every_link_inside_the_repository_leads_somewhere() {
    let mut count = 0;
    for (path, text) in documents() {
        for rest in text.split("](").skip(1) {
            let target = rest.split(')').next().expect("splits into one");
            let Some((file, fragment)) = target.split_once('#').filter(|_| !target.contains("://")) else {
                continue;
            };
            let page = if file.is_empty() {
                path.clone()
            } else {
                path.parent().unwrap().join(file)
            };
            let page = std::fs::read_to_string(&page)
                .unwrap_or_else(|error| panic!("{}: {target}: {error}", path.display()));
            assert!(anchors(&page).contains(fragment), "{}: {target}", path.display());
        }
    }
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
