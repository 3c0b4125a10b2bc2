//! A pseudo-terminal, with so much of a terminal behind it as is needed to see what a program shows.

use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};

use rustix::fs::{Mode, OFlags, open};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcgetattr, tcsetwinsize};

use super::until;

/// A terminal with a screen and a keyboard.
pub(crate) struct Terminal {
    keyboard_and_screen: std::fs::File,
    /// The end of the programs; held, so that the terminal outlives them.
    line: OwnedFd,
    screen: Screen,
}

impl Terminal {
    /// A terminal of so many columns and rows.
    pub(crate) fn open(columns: u16, rows: u16) -> Self {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let controller = openpt(flags).unwrap();
        grantpt(&controller).unwrap();
        unlockpt(&controller).unwrap();
        let name = ptsname(&controller, Vec::new()).unwrap();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let line = open(name, flags, Mode::empty()).unwrap();
        rustix::io::ioctl_fionbio(&controller, true).unwrap();
        let mut terminal = Self {
            keyboard_and_screen: controller.into(),
            line,
            screen: Screen::new(columns, rows),
        };
        terminal.resize(columns, rows);
        terminal
    }

    /// Starts a program as the leader of a session of this terminal, as a login does.
    #[expect(unsafe_code, reason = "what happens between fork and exec is unsafe to state")]
    pub(crate) fn start(&self, command: &mut Command) -> Child {
        let end = || Stdio::from(self.line.try_clone().unwrap());
        command.stdin(end()).stdout(end()).stderr(end());
        let lead_a_session = || {
            // Under `nohup` no terminal can end; this program has one.
            // SAFETY: the default handling is no code of this process.
            unsafe { libc::signal(libc::SIGHUP, libc::SIG_DFL) };
            rustix::process::setsid()?;
            rustix::process::ioctl_tiocsctty(rustix::stdio::stdin())?;
            Ok(())
        };
        // SAFETY: it does three system calls and neither allocates nor locks.
        unsafe { command.pre_exec(lead_a_session) };
        command.spawn().unwrap()
    }

    /// Changes the size; the system tells the program.
    pub(crate) fn resize(&mut self, columns: u16, rows: u16) {
        let size = Winsize {
            ws_row: rows,
            ws_col: columns,
            ws_xpixel: 0,
            ws_ypixel: 0,
        };
        self.screen = Screen {
            is_alternate: self.screen.is_alternate,
            has_cursor: self.screen.has_cursor,
            ..Screen::new(columns, rows)
        };
        tcsetwinsize(&self.keyboard_and_screen, size).unwrap();
    }

    /// The settings, of which raw mode is one.
    pub(crate) fn settings(&self) -> String {
        format!("{:?}", tcgetattr(&self.line).unwrap())
    }

    /// Types keys.
    pub(crate) fn press(&mut self, keys: &str) {
        self.keyboard_and_screen.write_all(keys.as_bytes()).unwrap();
    }

    /// Waits until the screen shows something.
    pub(crate) fn await_screen<T>(&mut self, what: &str, mut find: impl FnMut(&Screen) -> Option<T>) -> T {
        until(what, || {
            self.look();
            find(&self.screen)
        })
    }

    /// Waits until the screen shows this text.
    pub(crate) fn await_text(&mut self, text: &str) {
        self.await_screen(text, |screen| screen.text().contains(text).then_some(()));
    }

    /// Waits for the end of a program.
    pub(crate) fn await_exit(&mut self, program: &mut Child) -> ExitStatus {
        let status = until("the end of the program", || {
            self.look();
            program.try_wait().unwrap()
        });
        self.look();
        status
    }

    /// The content of its screen, as far as it has been looked at.
    pub(crate) fn screen(&self) -> &Screen {
        &self.screen
    }

    fn look(&mut self) {
        let mut bytes = [0; 4096];
        while let Ok(length @ 1..) = self.keyboard_and_screen.read(&mut bytes) {
            self.screen.feed(&bytes[..length]);
        }
    }
}

/// The content of a terminal, as far as programs ask for it that move the cursor and print.
pub(crate) struct Screen {
    cells: Vec<Vec<String>>,
    row: usize,
    column: usize,
    /// Bytes of a character or a sequence that is not complete yet.
    incomplete: Vec<u8>,
    pub(crate) is_alternate: bool,
    pub(crate) has_cursor: bool,
}

impl Screen {
    fn new(columns: u16, rows: u16) -> Self {
        Self {
            cells: vec![vec![" ".to_owned(); columns.into()]; rows.into()],
            row: 0,
            column: 0,
            incomplete: Vec::new(),
            is_alternate: false,
            has_cursor: true,
        }
    }

    /// Its lines.
    pub(crate) fn lines(&self) -> impl Iterator<Item = String> {
        self.cells.iter().map(|row| row.concat().trim_end().to_owned())
    }

    /// Its lines as one text.
    pub(crate) fn text(&self) -> String {
        self.lines().collect::<Vec<_>>().join("\n")
    }

    fn feed(&mut self, bytes: &[u8]) {
        self.incomplete.extend(bytes);
        while let Some(length) = length_of_first(&self.incomplete) {
            let first: Vec<_> = self.incomplete.drain(..length).collect();
            let first = String::from_utf8_lossy(&first).into_owned();
            match first.strip_prefix("\x1b[") {
                Some(sequence) => self.obey(sequence),
                None => self.print(&first),
            }
        }
    }

    fn obey(&mut self, sequence: &str) {
        let (parameters, command) = sequence.split_at(sequence.len() - 1);
        match (parameters, command) {
            ("?1049", _) => {
                self.is_alternate = command == "h";
                self.clear();
            }
            ("?25", _) => self.has_cursor = command == "h",
            (_, "J") => self.clear(),
            (place, "H") => {
                let mut numbers = place.split(';').map(|number| number.parse().unwrap_or(1));
                self.row = numbers.next().unwrap_or(1) - 1;
                self.column = numbers.next().unwrap_or(1) - 1;
            }
            // Colours and the like are not looked at.
            _ => {}
        }
    }

    fn clear(&mut self) {
        self.cells
            .iter_mut()
            .flatten()
            .for_each(|cell| " ".clone_into(cell));
        (self.row, self.column) = (0, 0);
    }

    fn print(&mut self, character: &str) {
        match character {
            "\r" => self.column = 0,
            "\n" => self.row += 1,
            // It goes onto the character before it.
            "\u{302}" => {
                if let Some(cell) = self.cell(self.column.saturating_sub(1)) {
                    *cell += character;
                }
            }
            _ => {
                if let Some(cell) = self.cell(self.column) {
                    character.clone_into(cell);
                }
                self.column += 1;
            }
        }
    }

    /// A cell of this row, if there is one: a program may still be drawing for the size before.
    fn cell(&mut self, column: usize) -> Option<&mut String> {
        self.cells.get_mut(self.row)?.get_mut(column)
    }
}

/// Length of the character or of the control sequence at the beginning; none if it is not complete.
fn length_of_first(bytes: &[u8]) -> Option<usize> {
    match *bytes.first()? {
        0x1b => {
            let parameters = bytes.get(2..)?.iter();
            parameters
                .take_while(|byte| !(0x40..=0x7e).contains(*byte))
                .count()
                .checked_add(3)
                .filter(|&length| length <= bytes.len())
        }
        first => {
            let length = match first {
                0xf0.. => 4,
                0xe0.. => 3,
                0xc0.. => 2,
                _ => 1,
            };
            (length <= bytes.len()).then_some(length)
        }
    }
}
