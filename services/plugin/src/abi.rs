//! The C interface of a plug-in, version 1. `gerono.h` has the same declarations ([`crate::header`]).

use std::cell::Cell;
use std::ffi::{c_char, c_int, c_void};

use crate::math::Math;

/// Version of the interface.
pub const VERSION: u32 = 1;

/// Name of the function that a library exports, `const gerono_plugin *gerono_plugin_v1(void)`.
pub const ENTRY: &str = "gerono_plugin_v1";

/// Type of the exported function.
pub type Entry = unsafe extern "C" fn() -> *const Plugin;

/// `gerono_now`: time of a step, with the operator's requests.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Now {
    /// Base tick since the start of the flight.
    pub tick: u64,
    /// Time of the tick since the start of the flight, ns.
    pub time_ns: u64,
    /// Time since this service's previous step, ns; 0 at its first.
    pub elapsed_ns: u64,
    /// Not 0 if the motors may turn.
    pub armed: u8,
    /// Not 0 if the vehicle must land.
    pub land: u8,
    /// Not 0 if the motors stop for ever.
    pub killed: u8,
    /// Number of requests to arm so far, modulo 32.
    pub arm_count: u8,
    /// Zero.
    pub pad: [u8; 4],
}

/// `gerono_input`: the newest sample of a topic.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Input {
    /// The sample; null before the first.
    pub sample: *const c_void,
    /// Not 0 if it was delivered since this service's previous step.
    pub fresh: u64,
}

/// `gerono_output`: the place for a sample of a topic.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Output {
    /// The place, zero but for its header; null if no sample is due.
    pub sample: *mut c_void,
}

/// `gerono_parameter`: a number of the scenario's table `plugins.parameters`.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Parameter {
    /// Its name, UTF-8.
    pub name: *const c_char,
    /// Its value.
    pub value: f64,
}

/// `gerono_setup`: what a service may know when it is made.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Setup {
    /// The scenario as JSON, UTF-8.
    pub scenario: *const c_char,
    /// The parameters, sorted by name.
    pub parameters: *const Parameter,
    /// Number of parameters.
    pub parameter_count: usize,
    /// Marks that the library makes: 1 for each parameter that it has asked for, and last for having asked at all. A
    /// library that was built before they were there makes none.
    pub asked: *const Cell<u8>,
    /// Functions with the same results on every machine; a library that was built before they were there takes none.
    pub math: *const Math,
}

/// `gerono_plugin`: a service.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Plugin {
    /// [`VERSION`].
    pub abi: u32,
    /// Size of this structure, bytes.
    pub size: u32,
    /// Name of the service, such as `controller`.
    pub service: *const c_char,
    /// Layout hashes of the inputs, then of the outputs, in the order of the wiring table.
    pub layouts: *const *const c_char,
    /// Number of layout hashes.
    pub layout_count: usize,
    /// Makes a service; null if it cannot, with the reason as a text of at most `size` bytes with its zero.
    pub create: Option<unsafe extern "C" fn(*const Setup, *mut c_char, usize) -> *mut c_void>,
    /// Advances to a time and writes the outputs that are due; 0 if all is well.
    pub step: Option<unsafe extern "C" fn(*mut c_void, *const Now, *const Input, *const Output) -> c_int>,
    /// Returns the size of the state, bytes: the same at all times.
    pub state_size: Option<unsafe extern "C" fn(*const c_void) -> usize>,
    /// Writes the state after the last step.
    pub save: Option<unsafe extern "C" fn(*const c_void, *mut c_void)>,
    /// Continues from a saved state as if nothing had happened.
    pub restore: Option<unsafe extern "C" fn(*mut c_void, *const c_void)>,
    /// Frees the service.
    pub destroy: Option<unsafe extern "C" fn(*mut c_void)>,
}

// SAFETY: a `Plugin` is a constant of a library: its pointers lead to constants too, which nobody writes.
#[expect(unsafe_code, reason = "raw pointers to constants")]
unsafe impl Sync for Plugin {}
