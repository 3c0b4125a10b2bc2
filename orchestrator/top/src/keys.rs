//! The meanings of the keys. Nothing is broken without a confirmation, and nothing at all unless that was permitted; no gain
//! is set before its new value has been typed.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use run_client::Question;
use run_client::snapshot::ServiceSnapshot;

/// Beginning of every key that can be set.
const COMMON_SECTION: &str = "controller.";

/// Bytes that a setting has at most.
const LONGEST_SETTING: usize = 120;

/// A key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// Up.
    Up,
    /// Down.
    Down,
    /// A character, as typed.
    Character(char),
    /// Enter.
    Enter,
    /// Backspace.
    Backspace,
    /// Escape.
    Escape,
    /// Ctrl-C.
    Interrupt,
    /// Any other one.
    Other,
}

impl Key {
    /// The key of an event.
    #[must_use]
    pub fn of(event: &KeyEvent) -> Self {
        let is_control = event.modifiers.contains(KeyModifiers::CONTROL);
        match event.code {
            KeyCode::Char('c') if is_control => Self::Interrupt,
            KeyCode::Char(character) if event.modifiers.difference(KeyModifiers::SHIFT).is_empty() => {
                Self::Character(character)
            }
            KeyCode::Up => Self::Up,
            KeyCode::Down => Self::Down,
            KeyCode::Enter => Self::Enter,
            KeyCode::Backspace => Self::Backspace,
            KeyCode::Esc => Self::Escape,
            _ => Self::Other,
        }
    }
}

/// A way to break a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Break {
    /// SIGKILL.
    Kill,
    /// SIGSTOP.
    Freeze,
}

/// An intent that waits for a confirmation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Intent {
    /// The way to do it.
    pub how: Break,
    /// To the service of this name.
    pub service: String,
    /// As long as it is this process.
    pub pid: u32,
}

impl Intent {
    fn question(self) -> Question {
        match self.how {
            Break::Kill => Question::KillService(self.service),
            Break::Freeze => Question::FreezeService(self.service),
        }
    }
}

/// The present meaning of the keys.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Looking.
    Watch,
    /// Reading the help.
    Help,
    /// About to break a service.
    Confirm(Intent),
    /// Typing a setting.
    Set(String),
}

/// The consequence of a key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Nothing beyond another picture.
    None,
    /// The view is left.
    Leave,
    /// The run is asked for something.
    Ask(Question),
}

/// The user's selection and intent.
#[derive(Clone, Debug)]
pub struct Controls {
    may_break: bool,
    mode: Mode,
    selected: usize,
    gains: Vec<String>,
    notice: String,
}

impl Controls {
    /// At the beginning; `may_break` permits to break services.
    #[must_use]
    pub fn new(may_break: bool) -> Self {
        Self {
            may_break,
            mode: Mode::Watch,
            selected: 0,
            gains: Vec::new(),
            notice: String::new(),
        }
    }

    /// Returns whether services may be broken.
    #[must_use]
    pub fn may_break(&self) -> bool {
        self.may_break
    }

    /// The present meaning of the keys.
    #[must_use]
    pub fn mode(&self) -> &Mode {
        &self.mode
    }

    /// Place of the selected service.
    #[must_use]
    pub fn selected(&self) -> usize {
        self.selected
    }

    /// The gains that can be set, with their present values, once the run has told them.
    #[must_use]
    pub fn gains(&self) -> &[String] {
        &self.gains
    }

    /// Takes note of the gains and their present values.
    pub fn keep_gains(&mut self, gains: Vec<String>) {
        self.gains = gains;
    }

    /// Returns the notice to the user; empty if there is none.
    #[must_use]
    pub fn notice(&self) -> &str {
        &self.notice
    }

    /// Tells the user something, until the next key.
    pub fn tell(&mut self, notice: String) {
        self.notice = notice;
    }

    /// A key was pressed while the services were so.
    pub fn press(&mut self, key: Key, services: &[ServiceSnapshot]) -> Action {
        self.notice.clear();
        if key == Key::Interrupt {
            return Action::Leave;
        }
        match std::mem::replace(&mut self.mode, Mode::Watch) {
            Mode::Help => Action::None,
            Mode::Confirm(intent) => self.decide(intent, key, services),
            Mode::Set(setting) => self.type_in(setting, key),
            Mode::Watch => self.choose(key, services),
        }
    }

    fn choose(&mut self, key: Key, services: &[ServiceSnapshot]) -> Action {
        match key {
            Key::Character('q') | Key::Escape => return Action::Leave,
            Key::Up => self.selected = self.selected.saturating_sub(1),
            Key::Down => self.selected = (self.selected + 1).min(services.len().saturating_sub(1)),
            Key::Character('?') => self.mode = Mode::Help,
            Key::Character('k') => self.intend(Break::Kill, services),
            Key::Character('f') => self.intend(Break::Freeze, services),
            Key::Character('s') => {
                self.mode = Mode::Set(COMMON_SECTION.to_owned());
                return Action::Ask(Question::Get(Vec::new()));
            }
            Key::Character(_) | Key::Enter | Key::Backspace | Key::Interrupt | Key::Other => {}
        }
        Action::None
    }

    fn type_in(&mut self, mut setting: String, key: Key) -> Action {
        match key {
            Key::Escape => {
                self.notice = "nothing was set".to_owned();
                return Action::None;
            }
            Key::Enter if setting.contains('=') => return Action::Ask(Question::Set(vec![setting])),
            Key::Character(character) if setting.len() < LONGEST_SETTING => setting.push(character),
            Key::Backspace => {
                setting.pop();
            }
            _ => {}
        }
        self.mode = Mode::Set(setting);
        Action::None
    }

    fn intend(&mut self, how: Break, services: &[ServiceSnapshot]) {
        if !self.may_break {
            self.notice = "only looking; `gerono top --allow-faults` can kill and freeze services".to_owned();
            return;
        }
        match services.get(self.selected) {
            Some(service) if service.flies => {
                self.mode = Mode::Confirm(Intent {
                    how,
                    service: service.name.clone(),
                    pid: service.pid,
                });
            }
            Some(service) => self.notice = format!("`{}` does not fly now", service.name),
            None => self.notice = "no service is known yet".to_owned(),
        }
    }

    /// Only `y` does it, and only to the process that was there when the question was asked.
    fn decide(&mut self, intent: Intent, key: Key, services: &[ServiceSnapshot]) -> Action {
        if key != Key::Character('y') {
            self.notice = "nothing was done".to_owned();
            return Action::None;
        }
        let is_the_same = |service: &ServiceSnapshot| {
            service.flies && service.name == intent.service && service.pid == intent.pid
        };
        if services.iter().any(is_the_same) {
            return Action::Ask(intent.question());
        }
        self.notice = format!(
            "process {} of `{}` is gone meanwhile; nothing was done",
            intent.pid, intent.service
        );
        Action::None
    }
}

#[cfg(test)]
mod tests;
