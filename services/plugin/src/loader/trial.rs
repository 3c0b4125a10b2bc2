//! Verification of a service's saved state: a second instance restores it, repeats some steps, and must write the same
//! samples. So an incomplete `save` is detected in every flight, and not only after a death.

use std::ffi::c_void;

use shared_types::Header;
use shared_types::service::{ErasedService, InputView, OutputSlot};

use super::{PluginService, Ports};
use crate::abi;
use crate::guarded::Guarded;

/// Steps between the beginnings of two trials. The first one begins at the second step, when the state is not initial.
const PERIOD: u64 = 500;

/// Steps of a trial.
const STEPS: u64 = 10;

/// Bytes of a sample that the host writes.
const HEADER: usize = size_of::<Header>();

/// Trials of a service.
pub(super) struct Trial {
    second: PluginService,
    /// Steps of the service since it was made.
    steps: u64,
    /// State of the service before a verified step.
    state: Guarded,
    /// The last step of the service, if it is verified; the second instance has its inputs.
    step: Option<(abi::Now, Ports)>,
}

impl Trial {
    pub(super) fn new(second: PluginService) -> Self {
        Self {
            state: Guarded::new(second.state_size),
            second,
            steps: 0,
            step: None,
        }
    }

    /// Stores state and inputs of the next step for the second instance, if the step is verified.
    #[inline]
    pub(super) fn prepare(
        &mut self,
        service: &PluginService,
        now: &abi::Now,
        inputs: &[InputView<'_>],
        outputs: &[OutputSlot<'_>],
    ) {
        let is_verified = (1..=STEPS).contains(&(self.steps % PERIOD));
        self.steps += 1;
        self.step = is_verified.then(|| {
            service.save_with(&mut |state| self.state.bytes_mut().copy_from_slice(state));
            (*now, self.second.copy_ports(inputs, outputs))
        });
    }

    /// Repeats the last step of `service` in the second instance, if it is verified. Restores the state only now, so that
    /// data shared by both instances, such as a global variable of the library, was unaffected during the step of
    /// `service`.
    ///
    /// # Errors
    /// The difference, if a sample differs.
    #[inline]
    pub(super) fn repeat(&mut self, service: &PluginService) -> Result<(), String> {
        match self.step.take() {
            None => Ok(()),
            Some((now, ports)) => self.repeat_step(service, &now, ports),
        }
    }

    #[cold]
    fn repeat_step(&mut self, service: &PluginService, now: &abi::Now, ports: Ports) -> Result<(), String> {
        self.second.restore(self.state.bytes());
        self.second.step_in_memory(now, ports);
        let samples = service.outputs.iter().zip(&self.second.outputs);
        let mut differs = samples.zip(service.role.outputs()).enumerate();
        let differs = differs.find(|(index, ((one, other), _))| {
            let (one, other) = (&one.bytes()[HEADER..], &other.bytes()[HEADER..]);
            ports.due >> index & 1 != 0 && one != other
        });
        match differs {
            None => Ok(()),
            Some((_, (_, output))) => Err(format!(
                "forgets a part of its state: a second instance that got the saved state wrote another `{}` at tick {}; \
                 `save` and `restore` must keep all on which a step depends besides its inputs",
                output.topic, now.tick
            )),
        }
    }

    /// Takes the second instance, to free it.
    pub(super) fn take_instance(&mut self) -> *mut c_void {
        std::mem::replace(&mut self.second.instance, std::ptr::null_mut())
    }
}
