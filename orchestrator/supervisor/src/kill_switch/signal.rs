//! Signals of a device: events of the kernel's input system, or bytes of a serial line.

use std::ffi::c_long;
use std::fmt::{Display, Formatter};

/// Size of the timestamp at the start of an event, bytes.
const TIME_SIZE: usize = 2 * size_of::<c_long>();

/// Size of `struct input_event`, bytes: the time, type (u16), code (u16) and value (i32).
pub const EVENT_SIZE: usize = TIME_SIZE + 8;

/// Event types of the kernel's input-event-codes.h.
const EV_SYN: u16 = 0;
const EV_KEY: u16 = 1;
const TYPES: [&str; 6] = ["EV_SYN", "EV_KEY", "EV_REL", "EV_ABS", "EV_MSC", "EV_SW"];
const SYN_DROPPED: u16 = 3;

/// Names of a keyboard's keys by code, from 1.
const KEYS: &str = "ESC 1 2 3 4 5 6 7 8 9 0 MINUS EQUAL BACKSPACE TAB Q W E R T Y U I O P LEFTBRACE RIGHTBRACE ENTER \
    LEFTCTRL A S D F G H J K L SEMICOLON APOSTROPHE GRAVE LEFTSHIFT BACKSLASH Z X C V B N M COMMA DOT SLASH RIGHTSHIFT \
    KPASTERISK LEFTALT SPACE CAPSLOCK F1 F2 F3 F4 F5 F6 F7 F8 F9 F10 NUMLOCK SCROLLLOCK KP7 KP8 KP9 KPMINUS KP4 KP5 KP6 \
    KPPLUS KP1 KP2 KP3 KP0 KPDOT";

/// First codes of groups of numbered buttons, with their names: of switch boxes, mice and gamepads.
const BUTTONS: [(u16, &str); 4] = [
    (0x100, "button"),
    (0x110, "mouse button"),
    (0x120, "joystick button"),
    (0x130, "gamepad button"),
];

/// Event of an input device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputEvent {
    /// Event type, such as EV_KEY.
    pub kind: u16,
    /// Code within the type, such as that of a key.
    pub code: u16,
    /// For keys: 0 for a release, 1 for a press, 2 for a repetition.
    pub value: i32,
}

/// Signal of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// Event of an input device.
    Event(InputEvent),
    /// Byte of a serial line.
    Byte(u8),
}

impl InputEvent {
    /// Returns the press of a key.
    #[must_use]
    pub fn press(code: u16) -> Self {
        Self {
            kind: EV_KEY,
            code,
            value: 1,
        }
    }

    /// Parses an event, in the byte order of the machine.
    #[must_use]
    pub fn parse(bytes: &[u8; EVENT_SIZE]) -> Self {
        let half = |at: usize| [bytes[TIME_SIZE + at], bytes[TIME_SIZE + at + 1]];
        let [low, high] = [half(4), half(6)];
        Self {
            kind: u16::from_ne_bytes(half(0)),
            code: u16::from_ne_bytes(half(2)),
            value: i32::from_ne_bytes([low[0], low[1], high[0], high[1]]),
        }
    }

    /// Returns the bytes of the event, with timestamp 0.
    #[must_use]
    pub fn to_bytes(self) -> [u8; EVENT_SIZE] {
        let mut bytes = [0; EVENT_SIZE];
        bytes[TIME_SIZE..TIME_SIZE + 2].copy_from_slice(&self.kind.to_ne_bytes());
        bytes[TIME_SIZE + 2..TIME_SIZE + 4].copy_from_slice(&self.code.to_ne_bytes());
        bytes[TIME_SIZE + 4..].copy_from_slice(&self.value.to_ne_bytes());
        bytes
    }

    /// Returns whether the kernel dropped events before this one because they were not read in time.
    #[must_use]
    pub fn has_dropped_events(&self) -> bool {
        (self.kind, self.code) == (EV_SYN, SYN_DROPPED)
    }
}

impl Signal {
    /// Returns the code of the key or byte if the signal is a press. Repetitions count as presses.
    #[must_use]
    pub fn press(&self) -> Option<u32> {
        match self {
            Self::Event(event) => (event.kind == EV_KEY && event.value != 0).then(|| u32::from(event.code)),
            Self::Byte(byte) => Some(u32::from(*byte)),
        }
    }

    /// Returns whether the signal is a press of this key, or of any if `None`.
    #[must_use]
    pub fn is_press(&self, key: Option<u32>) -> bool {
        self.press().is_some_and(|code| key.is_none_or(|key| key == code))
    }

    /// Returns whether the event only separates others.
    #[must_use]
    pub fn is_separator(&self) -> bool {
        matches!(self, Self::Event(event) if event.kind == EV_SYN && !event.has_dropped_events())
    }
}

impl Display for Signal {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Byte(byte) => {
                write!(formatter, "byte {byte} ('{}')", byte.escape_ascii())
            }
            Self::Event(event) if event.kind == EV_KEY => {
                let (name, code) = (key_name(event.code), event.code);
                match event.value {
                    0 => write!(formatter, "key {code} ({name}) released"),
                    1 => write!(formatter, "key {code} ({name}) pressed"),
                    2 => write!(formatter, "key {code} ({name}) repeated"),
                    value => write!(formatter, "key {code} ({name}) value {value}"),
                }
            }
            Self::Event(event) => {
                let (kind, code, value) = (event.kind, event.code, event.value);
                match TYPES.get(usize::from(kind)) {
                    Some(name) => write!(formatter, "{name} code {code} value {value}"),
                    None => write!(formatter, "type {kind} code {code} value {value}"),
                }
            }
        }
    }
}

/// Returns the name of a key.
fn key_name(code: u16) -> String {
    let keyboard = usize::from(code).checked_sub(1);
    if let Some(name) = keyboard.and_then(|at| KEYS.split_whitespace().nth(at)) {
        return name.to_owned();
    }
    let of_buttons = BUTTONS.iter().find(|(first, _)| code & !0xf == *first);
    of_buttons.map_or_else(
        || "unnamed".to_owned(),
        |(first, name)| format!("{name} {}", code - first),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(code: u16, value: i32) -> Signal {
        Signal::Event(InputEvent {
            value,
            ..InputEvent::press(code)
        })
    }

    #[test]
    fn an_event_is_the_same_after_its_bytes() {
        let event = InputEvent {
            kind: 3,
            code: 0x2ff,
            value: -70_000,
        };
        assert_eq!(InputEvent::parse(&event.to_bytes()), event);
    }

    #[test]
    fn a_key_that_goes_down_or_stays_there_is_a_press_and_nothing_else_is() {
        assert!(key(57, 1).is_press(None) && key(57, 2).is_press(Some(57)));
        assert!(!key(57, 0).is_press(None) && !key(57, 1).is_press(Some(28)));
        for kind in [0, 2, 3, 4] {
            let other = InputEvent {
                kind,
                ..InputEvent::press(57)
            };
            assert!(!Signal::Event(other).is_press(None));
        }
        assert!(Signal::Byte(b'k').is_press(None) && Signal::Byte(b'k').is_press(Some(107)));
        assert!(!Signal::Byte(b'k').is_press(Some(108)));
    }

    #[test]
    fn each_signal_has_its_name() {
        for (signal, words) in [
            (key(57, 1), "key 57 (SPACE) pressed"),
            (key(28, 0), "key 28 (ENTER) released"),
            (key(83, 2), "key 83 (KPDOT) repeated"),
            (key(84, 1), "key 84 (unnamed) pressed"),
            (key(0x101, 1), "key 257 (button 1) pressed"),
            (key(0x130, 1), "key 304 (gamepad button 0) pressed"),
            (Signal::Byte(b'k'), "byte 107 ('k')"),
            (Signal::Byte(0), "byte 0 ('\\x00')"),
        ] {
            assert_eq!(signal.to_string(), words);
        }
    }
}
