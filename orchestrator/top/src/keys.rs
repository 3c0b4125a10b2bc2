//! Meanings of the keys. Breaking a service needs a permission and a confirmation; a gain is set only after its new
//! value was typed.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use run_client::Question;
use run_client::snapshot::ServiceSnapshot;

/// Common prefix of the scenario keys that can be set.
const COMMON_SECTION: &str = "controller.";

/// Maximum length of a setting, bytes.
const MAX_SETTING: usize = 120;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    Up,
    Down,
    /// Typed character.
    Character(char),
    Enter,
    Backspace,
    Escape,
    Interrupt,
    Other,
}

impl Key {
    /// Returns the key of an event.
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

/// Way to break a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Break {
    /// SIGKILL.
    Kill,
    /// SIGSTOP.
    Freeze,
}

/// Request to break a service that waits for its confirmation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Intent {
    pub kind: Break,
    pub service: String,
    /// Process that the request is limited to.
    pub pid: u32,
}

impl Intent {
    fn question(self) -> Question {
        match self.kind {
            Break::Kill => Question::KillService(self.service),
            Break::Freeze => Question::FreezeService(self.service),
        }
    }
}

/// Meaning of the keys.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Mode {
    Watch,
    Help,
    /// Waiting for the confirmation of a break.
    Confirm(Intent),
    /// Typing a setting.
    Set(String),
}

/// Effect of a key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// None but a redraw.
    None,
    /// Quit.
    Leave,
    /// Send a question to the run.
    Ask(Question),
}

/// Selection and mode of the user.
#[derive(Clone, Debug)]
pub struct Controls {
    may_break: bool,
    mode: Mode,
    selected: usize,
    gains: Vec<String>,
    notice: String,
}

impl Controls {
    /// Creates the initial state; `may_break` permits to break services.
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

    #[must_use]
    pub fn may_break(&self) -> bool {
        self.may_break
    }

    #[must_use]
    pub fn mode(&self) -> &Mode {
        &self.mode
    }

    /// Returns the index of the selected service.
    #[must_use]
    pub fn selected(&self) -> usize {
        self.selected
    }

    /// Returns the gains that can be set as `KEY=VALUE`; empty before the run's answer.
    #[must_use]
    pub fn gains(&self) -> &[String] {
        &self.gains
    }

    /// Stores the gains and their present values.
    pub fn set_gains(&mut self, gains: Vec<String>) {
        self.gains = gains;
    }

    /// Returns the notice to the user; empty if there is none.
    #[must_use]
    pub fn notice(&self) -> &str {
        &self.notice
    }

    /// Shows a notice until the next key.
    pub fn show_notice(&mut self, notice: String) {
        self.notice = notice;
    }

    /// Handles a key.
    pub fn press(&mut self, key: Key, services: &[ServiceSnapshot]) -> Action {
        self.notice.clear();
        if key == Key::Interrupt {
            return Action::Leave;
        }
        match std::mem::replace(&mut self.mode, Mode::Watch) {
            Mode::Help => Action::None,
            Mode::Confirm(intent) => self.confirm(intent, key, services),
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
            Key::Character('k') => self.request_break(Break::Kill, services),
            Key::Character('f') => self.request_break(Break::Freeze, services),
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
            Key::Character(character) if setting.len() < MAX_SETTING => setting.push(character),
            Key::Backspace => {
                setting.pop();
            }
            _ => {}
        }
        self.mode = Mode::Set(setting);
        Action::None
    }

    fn request_break(&mut self, kind: Break, services: &[ServiceSnapshot]) {
        if !self.may_break {
            self.notice = "only looking; `gerono top --allow-faults` can kill and freeze services".to_owned();
            return;
        }
        match services.get(self.selected) {
            Some(service) if service.flies => {
                self.mode = Mode::Confirm(Intent {
                    kind,
                    service: service.name.clone(),
                    pid: service.pid,
                });
            }
            Some(service) => self.notice = format!("`{}` does not fly now", service.name),
            None => self.notice = "no service is known yet".to_owned(),
        }
    }

    /// Breaks the service on `y`, and only the process that the question named.
    fn confirm(&mut self, intent: Intent, key: Key, services: &[ServiceSnapshot]) -> Action {
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
