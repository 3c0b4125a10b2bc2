//! Inputs and outputs of a step, as step logic sees them and as hosts hold them.

use zerocopy::FromBytes;

use crate::finiteness::FinitenessCheck;
use crate::moment::Now;
use crate::sample::{Header, Sample};

/// Newest sample of a topic delivered so far, if there is one.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a, T> {
    sample: Option<&'a T>,
    fresh: bool,
}

impl<'a, T: Sample> Input<'a, T> {
    /// Returns the newest sample delivered so far.
    #[must_use]
    #[inline]
    pub fn newest(&self) -> Option<&'a T> {
        self.sample
    }

    /// Returns the newest sample, if it was delivered since this service's previous step.
    #[must_use]
    #[inline]
    pub fn fresh(&self) -> Option<&'a T> {
        self.sample.filter(|_| self.fresh)
    }

    /// Returns the time since the newest sample was published, ns.
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

/// Buffer for a sample of a topic, if one is due at this step.
#[derive(Debug)]
pub struct Output<'a, T> {
    sample: Option<&'a mut T>,
}

impl<'a, T: Sample> Output<'a, T> {
    /// Returns the buffer of the sample, if one is due: zeroed, with its header filled in.
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

/// Input as hosts hold it: the bytes of the newest sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct InputView<'a> {
    /// The newest sample's bytes.
    pub bytes: Option<&'a [u8]>,
    /// `true` if it was delivered since the previous step.
    pub fresh: bool,
}

/// Output as hosts hold it: the bytes of a due sample.
#[derive(Debug, Default)]
pub struct OutputSlot<'a> {
    /// Buffer of the sample, zeroed except for its header; `None` when none is due.
    pub bytes: Option<&'a mut [u8]>,
}

/// A service's inputs, created from a host's views. Implemented by the wiring table.
pub trait Inputs<'a> {
    /// Creates the inputs from one view each, in the order of the wiring table.
    fn from_views(views: &[InputView<'a>]) -> Self;
}

/// A service's outputs, created from a host's slots. Implemented by the wiring table.
pub trait Outputs<'a> {
    /// Creates the outputs from one slot each, in the order of the wiring table.
    fn from_slots(slots: &'a mut [OutputSlot<'_>]) -> Self;
}

/// Properties of a sample type by which a host moves it as bytes.
#[derive(Clone, Copy, Debug)]
pub struct SampleKind {
    /// Size, bytes.
    pub size: usize,
    first_non_finite_field: fn(&[u8]) -> Option<&'static str>,
    zero: fn(&mut [u8]),
}

impl SampleKind {
    /// Returns the kind of samples of type `T`.
    #[must_use]
    pub const fn of<T: Sample>() -> Self {
        const {
            assert!(
                size_of::<T>().is_multiple_of(size_of::<u64>()) && align_of::<T>() <= align_of::<u64>(),
                "hosts keep samples in whole words"
            );
        }
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

    /// Returns the name of the first member that holds a number that is not finite.
    #[must_use]
    #[inline]
    pub fn first_non_finite_field(&self, bytes: &[u8]) -> Option<&'static str> {
        let mut check = FinitenessCheck::default();
        check.take_in(bytes);
        if check.is_surely_finite() {
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

/// Returns the header of a sample's bytes; every sample begins with one.
#[must_use]
#[inline]
pub fn header_of(bytes: &[u8]) -> Header {
    Header::read_from_prefix(bytes)
        .expect("a sample begins with a header")
        .0
}
