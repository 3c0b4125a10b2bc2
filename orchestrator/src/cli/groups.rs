//! The commands in groups, as `gerono --help` shows them.

use clap::builder::StyledStr;
use clap::{Command, CommandFactory, FromArgMatches};

use super::Cli;

/// The groups with their commands, in the order of the help, the man pages and the page of commands.
pub const GROUPS: [(&str, &[&str]); 6] = [
    ("Fly", &["new", "run", "check"]),
    (
        "Inspect",
        &[
            "info", "view", "report", "plot", "truth", "export", "digest", "recover",
        ],
    ),
    (
        "Compare",
        &["import", "replay", "diff", "reproduce", "faults", "grid", "sweep"],
    ),
    (
        "Laboratory",
        &["world", "mocap", "gnss", "lab", "rc", "operator", "identify"],
    ),
    (
        "Live flights",
        &["arm", "disarm", "kill", "stop", "set", "get", "top", "attach"],
    ),
    (
        "Machine",
        &[
            "doctor",
            "bench",
            "clean",
            "completions",
            "man",
            "schema",
            "header",
        ],
    ),
];

/// Width of the column of command names.
const NAMES: usize = 11;

/// Returns the command line of `gerono`, with its commands in groups.
#[must_use]
pub fn command() -> Command {
    let command = Cli::command();
    let template = template(&command);
    command.help_template(template)
}

/// Parses the command line of this process; ends the process with help or an error message where needed.
#[must_use]
pub fn parse() -> Cli {
    let matches = command().get_matches();
    Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

/// Returns the help template with the groups, since clap supports groups of options only.
fn template(command: &Command) -> StyledStr {
    let header = command.get_styles().get_header();
    let groups = GROUPS.map(|(title, names)| {
        let lines: String = names.iter().map(|name| line(command, name)).collect();
        format!("{header}{title}:{header:#}\n{lines}\n")
    });
    let mut template = StyledStr::from("{about-with-newline}\n{usage-heading} {usage}\n\n");
    template.push_str(&groups.concat());
    template.push_str(&format!(
        "`gerono help COMMAND` explains a command.\n\n{header}Options:{header:#}\n{{options}}{{after-help}}"
    ));
    template
}

/// Returns the line of a command in the help.
fn line(command: &Command, name: &str) -> String {
    let literal = command.get_styles().get_literal();
    let subcommand = command.find_subcommand(name);
    let about = subcommand.and_then(Command::get_about).map(StyledStr::to_string);
    let aliases = subcommand.into_iter().flat_map(Command::get_visible_aliases);
    let aliases: String = aliases.map(|alias| format!(" [alias: {alias}]")).collect();
    format!(
        "  {literal}{name:NAMES$}{literal:#}  {}{aliases}\n",
        about.unwrap_or_default()
    )
}

#[cfg(test)]
mod tests {
    use clap::builder::ValueParser;
    use clap::error::ErrorKind;

    use super::*;

    #[test]
    fn every_visible_command_is_in_one_group_in_the_order_of_the_groups() {
        let command = Cli::command();
        let visible = command.get_subcommands().filter(|command| !command.is_hide_set());
        let visible: Vec<_> = visible.map(Command::get_name).collect();
        let grouped: Vec<_> = GROUPS.iter().flat_map(|(_, names)| *names).copied().collect();
        assert_eq!(visible, grouped);
    }

    /// Asserts that every number of a command and of those inside it is refused if it is not finite.
    fn assert_numbers_are_checked(command: &Command, names: &[&str]) {
        let number = ValueParser::from(clap::value_parser!(f64)).type_id();
        let takes_number = |argument: &&clap::Arg| argument.get_value_parser().type_id() == number;
        let numbers = command.get_arguments().filter(takes_number);
        for option in numbers.map(|argument| argument.get_long().expect("a number is an option")) {
            for value in ["nan", "inf", "-inf", "-1", "1e300"] {
                let option = format!("--{option}={value}");
                let line = [names, &[&option]].concat();
                let error = super::command().try_get_matches_from(&line).unwrap_err();
                assert_eq!(error.kind(), ErrorKind::ValueValidation, "{line:?}: {error}");
            }
        }
        for inside in command.get_subcommands() {
            assert_numbers_are_checked(inside, &[names, &[inside.get_name()]].concat());
        }
    }

    #[test]
    fn every_number_of_every_command_has_limits() {
        assert_numbers_are_checked(&Cli::command(), &["gerono"]);
    }

    #[test]
    fn no_command_is_hidden_but_the_one_that_starts_services() {
        let command = Cli::command();
        let hidden = command.get_subcommands().filter(|command| command.is_hide_set());
        let hidden: Vec<_> = hidden.map(Command::get_name).collect();
        assert_eq!(hidden, ["service"]);
    }

    #[test]
    fn every_line_of_the_help_fits_eighty_columns() {
        let help = command().term_width(80).render_help().to_string();
        for name in GROUPS.iter().flat_map(|(_, names)| *names) {
            assert!(help.contains(&format!("\n  {name:NAMES$}  ")), "{help}");
        }
        for line in help.lines() {
            assert!(line.chars().count() <= 80, "{line}");
        }
    }
}
