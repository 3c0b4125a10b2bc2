//! Contract between a service's pure step logic and the hosts that run it.
//!
//! A [`Service`] is a function of its state, the time and its newest inputs. It has no clock, does no input or output
//! and does not allocate after construction. Hosts differ only in the source of the newest delivered sample: the
//! schedule (lock step, in process), the clock (real time) or a log (replay). They call a service through
//! [`ErasedService`], in bytes, so that one host serves every service.

use zerocopy::{FromBytes, IntoBytes};

pub use crate::moment::{ARM_COUNTS, Now, Operator, nanoseconds, seconds};
pub use crate::ports::{Input, InputView, Inputs, Output, OutputSlot, Outputs, SampleKind, header_of};
use crate::sample::Record;
use crate::tuning::Gains;
use crate::wiring::ServiceId;

/// Pure step logic of a service.
pub trait Service: Send {
    /// Identifier in the wiring table.
    const ID: ServiceId;
    /// Inputs by the wiring table.
    type Inputs<'a>: Inputs<'a>;
    /// Outputs by the wiring table.
    type Outputs<'a>: Outputs<'a>;
    /// State on which, besides the inputs, the next step depends.
    type State: Record;

    /// Advances to `now` and writes the outputs that are due.
    fn step(&mut self, now: &Now, inputs: &Self::Inputs<'_>, outputs: &mut Self::Outputs<'_>);

    /// Replaces the gains that may change in flight, from the next step on; `None` returns to those of the scenario.
    /// They are no part of the state. Services without such gains ignore it.
    fn tune(&mut self, _gains: Option<&Gains>) {}

    /// Returns the state after the last step.
    fn save(&self) -> Self::State;

    /// Continues from a saved state as if nothing had happened.
    fn restore(&mut self, state: &Self::State);
}

/// Error of a service that cannot be built or connected.
pub type BuildError = Box<dyn std::error::Error + Send + Sync>;

/// Service, or the error of its construction.
pub type Built = Result<Box<dyn ErasedService>, BuildError>;

/// Service as hosts use it. Implemented for every [`Service`].
pub trait ErasedService: Send {
    /// Returns its identifier.
    fn id(&self) -> ServiceId;
    /// [`Service::step`].
    fn step(&mut self, now: &Now, inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]);
    /// [`Service::tune`].
    fn tune(&mut self, _gains: Option<&Gains>) {}
    /// Returns whether hosts must call [`try_saved_state`](Self::try_saved_state) after each step. The result is
    /// constant.
    fn has_trials(&self) -> bool {
        false
    }
    /// Checks, after a step whose samples are published, that the saved state is complete: for foreign code, whose
    /// `save` may omit a part.
    ///
    /// # Errors
    /// The omitted part, as far as it can be determined.
    fn try_saved_state(&mut self) -> Result<(), String> {
        Ok(())
    }
    /// Brings connected hardware to rest at the end of the flight. It is not called if this process ends earlier and
    /// another one continues.
    fn finish(&mut self) {}
    /// Returns the size of a saved state, bytes.
    fn state_size(&self) -> usize;
    /// Passes the bytes of [`Service::save`], `state_size` of them, to `keep`.
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

    fn tune(&mut self, gains: Option<&Gains>) {
        Service::tune(self, gains);
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
