//! Man pages, and the page of commands in the manual.

use std::fs;
use std::io;
use std::path::Path;

use clap::Command;
use clap_mangen::Man;
use command_line::exit::Exit;

/// Width of the help in the page of commands.
const COLUMNS: usize = 100;

/// Writes `gerono.1` and a page for each command into `folder`.
///
/// # Errors
/// The error of creating the folder or writing a file.
pub fn write_man_pages(command: Command, folder: &Path) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let mut command = command.disable_help_subcommand(true);
    command.build();
    for (_, command) in visible(&command, "") {
        let page = Man::new(command.clone());
        let mut text = Vec::new();
        page.render(&mut text)?;
        result_file::write(&folder.join(page.get_filename()), text, &[])?;
    }
    Ok(())
}

/// Returns the man page of the whole program.
///
/// # Errors
/// Never in practice: the page is written to memory.
pub fn man_page(command: Command) -> io::Result<Vec<u8>> {
    let mut page = Vec::new();
    Man::new(command).render(&mut page)?;
    Ok(page)
}

/// Returns the parts of the page of commands: the help of each, and the exit codes.
#[must_use]
pub fn commands(command: Command) -> (String, String) {
    let mut command = command.disable_help_subcommand(true).term_width(COLUMNS);
    command.build();
    let help = visible(&command, "").into_iter().map(|(name, command)| {
        let help = command.clone().render_long_help().to_string();
        let lines: Vec<_> = help.lines().map(str::trim_end).collect();
        format!("### {name}\n\n```text\n{}\n```\n", lines.join("\n").trim())
    });
    let codes = Exit::MEANINGS.map(|(code, meaning)| format!("| {code} | {meaning} |\n"));
    (
        help.collect::<Vec<_>>().join("\n"),
        format!("| code | meaning |\n| --- | --- |\n{}", codes.concat()),
    )
}

/// Returns a command and its subcommands with their full names, without hidden ones.
fn visible<'a>(command: &'a Command, before: &str) -> Vec<(String, &'a Command)> {
    let name = format!("{before}{}", command.get_name());
    let inside = command.get_subcommands().filter(|inside| !inside.is_hide_set());
    let inside = inside.flat_map(|inside| visible(inside, &format!("{name} ")));
    let inside: Vec<_> = inside.collect();
    std::iter::once((name, command)).chain(inside).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Arg;

    fn example() -> Command {
        let hidden = Command::new("inner").hide(true);
        let run = Command::new("run").about("Flies.").arg(Arg::new("scenario"));
        Command::new("gerono").subcommand(run).subcommand(hidden)
    }

    #[test]
    fn every_visible_command_has_a_man_page() {
        let folder = tempfile::tempdir().unwrap();
        write_man_pages(example(), folder.path()).unwrap();
        let page = |name| fs::read_to_string(folder.path().join(name));
        assert!(page("gerono.1").unwrap().contains("gerono\\-run"));
        assert!(page("gerono-run.1").unwrap().contains("Flies."));
        assert!(page("gerono-inner.1").is_err());
        let page = String::from_utf8(man_page(example()).unwrap()).unwrap();
        assert!(page.contains("gerono\\-run"));
    }

    #[test]
    fn the_page_of_commands_has_all_that_users_can_call_and_each_exit_code() {
        let (help, codes) = commands(example());
        assert!(
            help.contains("### gerono run") && !help.contains("inner"),
            "{help}"
        );
        assert_eq!(codes.lines().count(), 2 + Exit::MEANINGS.len());
    }
}
