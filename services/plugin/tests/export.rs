//! No panic of a service in Rust leaves a function of the interface: the host is told, and the process lives.

#![expect(unsafe_code, reason = "the interface is in C")]

use std::cell::Cell;
use std::ffi::c_void;

use plugin::{Plugin, Setup, abi};
use shared_types::samples::ControlTelemetry;
use shared_types::service::BuildError;
use shared_types::wiring::{ControllerInputs, ControllerOutputs};
use shared_types::{Now, Service, ServiceId};
use zerocopy::FromZeros;

/// A controller whose functions panic if the scenario says so.
struct Frail {
    panics_in: f64,
}

impl Frail {
    fn pass(&self, place: f64) {
        assert!(self.panics_in != place, "asked for");
    }
}

impl Plugin for Frail {
    fn create(setup: &Setup<'_>) -> Result<Self, BuildError> {
        Ok(Self {
            panics_in: setup.parameter("panics_in", 0.0),
        })
    }
}

impl Service for Frail {
    const ID: ServiceId = ServiceId::Controller;
    type Inputs<'a> = ControllerInputs<'a>;
    type Outputs<'a> = ControllerOutputs<'a>;
    type State = ControlTelemetry;

    fn step(&mut self, _: &Now, _: &ControllerInputs<'_>, _: &mut ControllerOutputs<'_>) {}

    fn save(&self) -> ControlTelemetry {
        self.pass(1.0);
        ControlTelemetry::new_zeroed()
    }

    fn restore(&mut self, _: &ControlTelemetry) {
        self.pass(2.0);
    }
}

impl Drop for Frail {
    fn drop(&mut self) {
        self.pass(3.0);
    }
}

/// Makes the service, saves and restores its state, and returns what it then says of the size; frees it.
fn size_after(panics_in: f64) -> usize {
    let interface = plugin::export::plugin::<Frail>();
    let parameter = abi::Parameter {
        name: c"panics_in".as_ptr(),
        value: panics_in,
    };
    let asked = [const { Cell::new(0) }; 2];
    let setup = abi::Setup {
        scenario: c"{}".as_ptr(),
        parameters: &raw const parameter,
        parameter_count: 1,
        asked: asked.as_ptr(),
        math: &raw const plugin::math::MATH,
    };
    let mut state = ControlTelemetry::new_zeroed();
    let place: *mut c_void = (&raw mut state).cast();
    // SAFETY: every pointer leads to what the interface says, and outlives the calls.
    let size = unsafe {
        let service = interface.create.unwrap()(&raw const setup, std::ptr::null_mut(), 0);
        assert!(!service.is_null());
        assert_eq!(
            interface.state_size.unwrap()(service),
            size_of::<ControlTelemetry>()
        );
        interface.save.unwrap()(service, place);
        interface.restore.unwrap()(service, place);
        let size = interface.state_size.unwrap()(service);
        interface.destroy.unwrap()(service);
        size
    };
    assert_eq!(asked.map(Cell::into_inner), [1, 1]);
    size
}

#[test]
fn a_panic_in_any_function_is_told_by_the_size_of_the_state() {
    assert_eq!(size_after(0.0), size_of::<ControlTelemetry>());
    assert_eq!(size_after(1.0), usize::MAX);
    assert_eq!(size_after(2.0), usize::MAX);
    // Nothing is left to be told after the end.
    assert_eq!(size_after(3.0), size_of::<ControlTelemetry>());
}
