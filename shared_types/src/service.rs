//! The contract between a service's pure step logic and the hosts that run it.
//!
//! A [`Service`] is a function of its state, the time and its newest inputs. It has no clock, does no input
//! or output and does not allocate after construction. Hosts differ only in who decides which sample is the
//! newest one delivered: the schedule (lock-step, in-process), the clock (real time) or a log (replay).
//! They speak to a service through [`ErasedService`], in bytes, so that one host serves every service.

use serde::{Deserialize, Serialize};
use zerocopy::{FromBytes, IntoBytes};

use crate::glance::Glance;
use crate::sample::{Header, Record, Sample};
use crate::wiring::ServiceId;

/// The moment of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Now {
    /// Base tick since the start of the flight.
    pub tick: u64,
    /// Time of the tick since the start of the flight, ns.
    pub time_ns: u64,
    /// Time since this service's previous step, ns; 0 at its first.
    pub elapsed_ns: u64,
    /// What the people responsible for the flight ask for.
    pub operator: Operator,
}

/// What the people responsible for the flight ask for. Hosts say it, like the time. By default nothing: the motors rest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Operator {
    /// The motors may turn. Whoever takes it back in the air stops them there.
    pub armed: bool,
    /// The vehicle shall come down, and rest disarmed.
    pub land: bool,
    /// The motors shall rest, now and for ever: it is not taken back in a flight.
    pub killed: bool,
}

impl Operator {
    /// The flight is flown: nothing else is asked for.
    pub const FLYING: Self = Self {
        armed: true,
        land: false,
        killed: false,
    };
}

impl Now {
    /// Time since the start of the flight, s.
    #[must_use]
    #[inline]
    pub fn time(&self) -> f64 {
        seconds(self.time_ns)
    }

    /// Time since this service's previous step, s; 0 at its first.
    #[must_use]
    #[inline]
    pub fn elapsed(&self) -> f64 {
        seconds(self.elapsed_ns)
    }
}

/// Nanoseconds as seconds, correctly rounded.
#[must_use]
#[inline]
#[expect(
    clippy::cast_precision_loss,
    reason = "2^53 ns are 104 days, longer than any flight"
)]
pub fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 / 1e9
}

/// Seconds as nanoseconds, to the nearest; what is below 0 counts as 0, and what is beyond any flight as its end.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cast saturates"
)]
pub fn nanoseconds(seconds: f64) -> u64 {
    libm::round(seconds * 1e9) as u64
}

/// The newest sample of a topic that has been delivered by now, if there is any.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a, T> {
    sample: Option<&'a T>,
    fresh: bool,
}

impl<'a, T: Sample> Input<'a, T> {
    /// The newest sample delivered by now.
    #[must_use]
    #[inline]
    pub fn newest(&self) -> Option<&'a T> {
        self.sample
    }

    /// The newest sample, if it was delivered since this service's previous step.
    #[must_use]
    #[inline]
    pub fn fresh(&self) -> Option<&'a T> {
        self.sample.filter(|_| self.fresh)
    }

    /// Time since the newest sample was published, ns.
    #[must_use]
    #[inline]
    pub fn age_ns(&self, now: &Now) -> Option<u64> {
        self.sample
            .map(|sample| now.time_ns.saturating_sub(sample.header().stamp_ns))
    }

    #[doc(hidden)]
    #[inline]
    pub fn from_view(view: InputView<'a>) -> Self {
        let sample = view
            .bytes
            .map(|bytes| T::ref_from_bytes(bytes).expect("hosts hand out aligned samples of their topic"));
        Self {
            sample,
            fresh: view.fresh,
        }
    }
}

/// Place for a sample of a topic, if one is due at this step.
#[derive(Debug)]
pub struct Output<'a, T> {
    sample: Option<&'a mut T>,
}

impl<'a, T: Sample> Output<'a, T> {
    /// The place to write the sample to, if one is due: zeroed, with its header filled in.
    #[inline]
    pub fn due(&mut self) -> Option<&mut T> {
        self.sample.as_deref_mut()
    }

    #[doc(hidden)]
    #[inline]
    pub fn from_slot(slot: &'a mut OutputSlot<'_>) -> Self {
        let sample = slot
            .bytes
            .as_deref_mut()
            .map(|bytes| T::mut_from_bytes(bytes).expect("hosts hand out aligned samples of their topic"));
        Self { sample }
    }
}

/// An input as hosts hold it: the bytes of the newest sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct InputView<'a> {
    /// The newest sample's bytes.
    pub bytes: Option<&'a [u8]>,
    /// Whether it was delivered since the previous step.
    pub fresh: bool,
}

/// An output as hosts hold it: the bytes to write a due sample to.
#[derive(Debug, Default)]
pub struct OutputSlot<'a> {
    /// The place of the sample, zeroed but for its header; `None` when none is due.
    pub bytes: Option<&'a mut [u8]>,
}

/// A service's inputs, made from what a host holds. Implemented by the wiring table.
pub trait Inputs<'a> {
    /// One view an input, in the order of the wiring table.
    fn from_views(views: &[InputView<'a>]) -> Self;
}

/// A service's outputs, made from what a host holds. Implemented by the wiring table.
pub trait Outputs<'a> {
    /// One slot an output, in the order of the wiring table.
    fn from_slots(slots: &'a mut [OutputSlot<'_>]) -> Self;
}

/// The pure step logic of a service.
pub trait Service: Send {
    /// Which service of the wiring table this is.
    const ID: ServiceId;
    /// The inputs that the wiring table gives it.
    type Inputs<'a>: Inputs<'a>;
    /// The outputs that the wiring table gives it.
    type Outputs<'a>: Outputs<'a>;
    /// Everything that the next step depends on besides its inputs.
    type State: Record;

    /// Advances to `now` and writes the outputs that are due.
    fn step(&mut self, now: &Now, inputs: &Self::Inputs<'_>, outputs: &mut Self::Outputs<'_>);

    /// The state after the last step.
    fn save(&self) -> Self::State;

    /// Continues from a saved state as if nothing had happened.
    fn restore(&mut self, state: &Self::State);
}

/// Why a service cannot be built or connected.
pub type BuildError = Box<dyn std::error::Error + Send + Sync>;

/// A service, or why there is none.
pub type Built = Result<Box<dyn ErasedService>, BuildError>;

/// A service as hosts see it. Implemented for every [`Service`].
pub trait ErasedService: Send {
    /// Which service this is.
    fn id(&self) -> ServiceId;
    /// [`Service::step`].
    fn step(&mut self, now: &Now, inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]);
    /// Size of a saved state, bytes.
    fn state_size(&self) -> usize;
    /// Hands the bytes of [`Service::save`], `state_size` of them, to `keep`.
    fn save_with(&self, keep: &mut dyn FnMut(&[u8]));
    /// [`Service::save`] into `state_size` bytes.
    ///
    /// # Panics
    /// If `bytes` has another size.
    fn save(&self, bytes: &mut [u8]) {
        self.save_with(&mut |state| bytes.copy_from_slice(state));
    }
    /// [`Service::restore`] from `state_size` bytes.
    ///
    /// # Panics
    /// If `bytes` has another size.
    fn restore(&mut self, bytes: &[u8]);
}

impl<S: Service> ErasedService for S {
    fn id(&self) -> ServiceId {
        S::ID
    }

    #[inline]
    fn step(&mut self, now: &Now, inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        let inputs = S::Inputs::from_views(inputs);
        let mut outputs = S::Outputs::from_slots(outputs);
        Service::step(self, now, &inputs, &mut outputs);
    }

    fn state_size(&self) -> usize {
        size_of::<S::State>()
    }

    fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
        keep(Service::save(self).as_bytes());
    }

    fn restore(&mut self, bytes: &[u8]) {
        let state = S::State::read_from_bytes(bytes).expect("a state of this service has this size");
        Service::restore(self, &state);
    }
}

/// What a host needs to know of a sample type to move it around as bytes.
#[derive(Clone, Copy, Debug)]
pub struct SampleKind {
    /// Size, bytes.
    pub size: usize,
    first_non_finite_field: fn(&[u8]) -> Option<&'static str>,
    zero: fn(&mut [u8]),
}

impl SampleKind {
    /// The kind of samples of type `T`.
    #[must_use]
    pub const fn of<T: Sample>() -> Self {
        Self {
            size: size_of::<T>(),
            first_non_finite_field: |bytes| {
                let sample = T::ref_from_bytes(bytes).expect("hosts hand out aligned samples of their topic");
                sample.first_non_finite_field()
            },
            zero: |bytes| {
                let sample = T::mut_from_bytes(bytes).expect("hosts hand out aligned samples of their topic");
                sample.zero();
            },
        }
    }

    /// Name of the first member that holds a number that is not finite.
    #[must_use]
    #[inline]
    pub fn first_non_finite_field(&self, bytes: &[u8]) -> Option<&'static str> {
        let mut glance = Glance::default();
        glance.take_in(bytes);
        if glance.is_surely_finite() {
            None
        } else {
            (self.first_non_finite_field)(bytes)
        }
    }

    /// Zeroes a sample and fills its header in.
    #[inline]
    pub fn prepare(&self, bytes: &mut [u8], header: Header) {
        (self.zero)(bytes);
        let (place, _) = Header::mut_from_prefix(bytes).expect("a sample begins with a header");
        *place = header;
    }
}

/// Header of a sample's bytes; every sample begins with one.
#[must_use]
#[inline]
pub fn header_of(bytes: &[u8]) -> Header {
    Header::read_from_prefix(bytes)
        .expect("a sample begins with a header")
        .0
}
