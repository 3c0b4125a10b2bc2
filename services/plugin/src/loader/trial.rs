//! Trial of a service's saved state: a second instance gets it, takes the same steps for a while, and must write the same
//! samples. What `save` forgets is found so wherever the service flies, and not only where a death needs the state.

use std::ffi::c_void;

use shared_types::Header;
use shared_types::service::{ErasedService, InputView, OutputSlot};

use super::{PluginService, Ports};
use crate::abi;
use crate::guarded::Guarded;

/// Steps from the beginning of a trial to that of the next; the first one begins at the second step, when there is
/// something to forget.
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
    /// State of the service before a step that is tried.
    state: Guarded,
    /// The last step of the service, if the second instance is to repeat it; its inputs are there already.
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

    /// Keeps what the second instance needs to repeat the step that comes, if it is to be tried.
    #[inline]
    pub(super) fn prepare(
        &mut self,
        service: &PluginService,
        now: &abi::Now,
        inputs: &[InputView<'_>],
        outputs: &[OutputSlot<'_>],
    ) {
        let is_tried = (1..=STEPS).contains(&(self.steps % PERIOD));
        self.steps += 1;
        self.step = is_tried.then(|| {
            service.save_with(&mut |state| self.state.bytes_mut().copy_from_slice(state));
            (*now, self.second.take_in(inputs, outputs))
        });
    }

    /// Repeats the last step of `service` in the second instance, if it is tried. The state is restored only now: what both
    /// instances share, such as a variable of the library, is then as it would be without the trial.
    ///
    /// # Errors
    /// What is wrong, if a sample differs.
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

    /// Takes the second instance away, to be freed.
    pub(super) fn take_instance(&mut self) -> *mut c_void {
        std::mem::replace(&mut self.second.instance, std::ptr::null_mut())
    }
}
