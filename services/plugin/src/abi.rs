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
    /// Not 0 if the motors stop until the end of the run.
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

/// `gerono_output`: memory for a sample of a topic.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Output {
    /// The sample, zero except for its header; null if none is due.
    pub sample: *mut c_void,
}

/// `gerono_parameter`: a number of the scenario's table `plugins.parameters`.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Parameter {
    /// Name, UTF-8.
    pub name: *const c_char,
    /// Value.
    pub value: f64,
}

/// `gerono_setup`: input of the creation of a service.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Setup {
    /// The scenario as JSON, UTF-8.
    pub scenario: *const c_char,
    /// The parameters, sorted by name.
    pub parameters: *const Parameter,
    /// Number of parameters.
    pub parameter_count: usize,
    /// Marks set by the library: 1 for each requested parameter, and the last one for any request. A library that was built
    /// before this field existed sets none.
    pub asked: *const Cell<u8>,
    /// Functions with the same results on every machine; not used by a library that was built before this field existed.
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
    /// Creates a service; null on failure, with the reason as a text of at most `size` bytes including the final zero.
    pub create: Option<unsafe extern "C" fn(*const Setup, *mut c_char, usize) -> *mut c_void>,
    /// Executes a step and writes the due outputs; 0 on success.
    pub step: Option<unsafe extern "C" fn(*mut c_void, *const Now, *const Input, *const Output) -> c_int>,
    /// Returns the size of the state, bytes, which is constant.
    pub state_size: Option<unsafe extern "C" fn(*const c_void) -> usize>,
    /// Writes the state after the last step.
    pub save: Option<unsafe extern "C" fn(*const c_void, *mut c_void)>,
    /// Restores a saved state, from which later steps are identical.
    pub restore: Option<unsafe extern "C" fn(*mut c_void, *const c_void)>,
    /// Frees the service.
    pub destroy: Option<unsafe extern "C" fn(*mut c_void)>,
}

// SAFETY: a `Plugin` is a constant of a library, and its pointers point to constants.
#[expect(unsafe_code, reason = "raw pointers to constants")]
unsafe impl Sync for Plugin {}
