//! Encoder: from sticks to frames of the scenario's link.

use scenario::{RcLink, Transmitter};

use crate::channel_map::{ChannelMap, Units};
use crate::format::{self, Content, Format};
use crate::frame::Frame;
use crate::sticks::Sticks;

/// Encoder of the frames of a link.
#[derive(Debug)]
pub struct Encoder {
    map: ChannelMap,
    units: Units,
    format: Box<dyn Format>,
}

impl Encoder {
    /// Makes the encoder of a checked link; `None` for the simulated link.
    #[must_use]
    pub fn new(link: &RcLink, transmitter: &Transmitter) -> Option<Self> {
        let format = format::for_link(link, transmitter)?;
        Some(Self {
            map: ChannelMap::new(link, transmitter),
            units: format.units(),
            format,
        })
    }

    /// Encodes sticks into a frame. `failsafe` sets the link's failsafe flag, if it has one.
    #[inline]
    pub fn encode(&mut self, sticks: &Sticks, failsafe: bool, now_ns: u64, frame: &mut Frame) {
        frame.clear();
        let content = Content {
            codes: self.units.codes(&self.map.travels(sticks)),
            failsafe,
            sticks,
            map: &self.map,
            now_ns,
        };
        self.format.encode(&content, frame);
    }

    /// Encodes the request that is due beside the frame of these sticks, if any.
    #[inline]
    pub fn request(&mut self, sticks: &Sticks, frame: &mut Frame) {
        frame.clear();
        self.format.request(&self.map, sticks, frame);
    }

    /// Returns the format of the frames.
    pub(crate) fn format(&mut self) -> &mut dyn Format {
        &mut *self.format
    }

    /// Returns the units of the link's channels; pulses if it has none.
    #[must_use]
    pub fn units(&self) -> Units {
        self.units
    }

    /// Returns the channel map.
    #[must_use]
    pub fn map(&self) -> &ChannelMap {
        &self.map
    }

    /// Returns whether frames have a failsafe flag. Without one, stopping the frames signals failsafe.
    #[must_use]
    pub fn has_failsafe_flag(&self) -> bool {
        self.format.has_failsafe_flag()
    }
}
