//! Receivers, and the cameras of a hall beside them, in place of the simulated plant.
//!
//! Each part writes topics of its own and fails by itself: the samples of the one go on while the source of the other is lost. The
//! state is that of the cameras and then that of the receivers.

use shared_types::service::{ErasedService, InputView, OutputSlot};
use shared_types::{Now, ServiceId};

use super::motion_capture_driver::{self, MotionCaptureDriver};
use super::receiver_driver::{self, ReceiverDriver};

const STATE_SIZE: usize = motion_capture_driver::STATE_SIZE + receiver_driver::STATE_SIZE;

/// Receivers and cameras of a flight.
pub(super) struct ReceiversAndCameras {
    pub(super) cameras: MotionCaptureDriver,
    pub(super) receivers: ReceiverDriver,
}

impl ErasedService for ReceiversAndCameras {
    fn id(&self) -> ServiceId {
        ServiceId::Plant
    }

    fn step(&mut self, now: &Now, inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        self.cameras.step(now, inputs, outputs);
        self.receivers.step(now, inputs, outputs);
    }

    fn state_size(&self) -> usize {
        STATE_SIZE
    }

    fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
        let mut state = [0; STATE_SIZE];
        let (of_cameras, of_receivers) = state.split_at_mut(motion_capture_driver::STATE_SIZE);
        self.cameras.save(of_cameras);
        self.receivers.save(of_receivers);
        keep(&state);
    }

    fn restore(&mut self, bytes: &[u8]) {
        let (of_cameras, of_receivers) = bytes.split_at(motion_capture_driver::STATE_SIZE);
        self.cameras.restore(of_cameras);
        self.receivers.restore(of_receivers);
    }
}

#[cfg(test)]
mod tests;
