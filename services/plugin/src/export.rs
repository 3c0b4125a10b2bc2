//! The C interface of a service in Rust.
//!
//! A library of the kind `cdylib` has one [`Plugin`], and [`export!`](crate::export!) makes the exported function:
//!
//! ```ignore
//! plugin::export!(MyController);
//! ```

use std::cell::Cell;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

use scenario::Scenario;
use shared_types::schedule::MAX_PORTS;
use shared_types::service::{BuildError, ErasedService, InputView, OutputSlot};
use shared_types::{Now, Operator, Service};

use crate::abi;

/// Service that a library exports.
pub trait Plugin: Service {
    /// Makes the service of a flight.
    ///
    /// # Errors
    /// The reason why the scenario is not supported.
    fn create(setup: &Setup<'_>) -> Result<Self, BuildError>
    where
        Self: Sized;
}

/// Service behind the interface. No panic may cross a function of the interface.
struct Exported<S> {
    service: S,
    /// `true` after a panic in `save` or `restore`: `state_size` then returns [`BROKEN`].
    is_broken: Cell<bool>,
}

/// Size of the state after a panic, which the host refuses.
const BROKEN: usize = usize::MAX;

/// Input of the creation of a service.
#[derive(Clone, Copy, Debug)]
pub struct Setup<'a>(&'a abi::Setup);

impl<'a> Setup<'a> {
    /// Wraps the setup of a host.
    #[must_use]
    pub fn new(setup: &'a abi::Setup) -> Self {
        Self(setup)
    }

    /// Returns a number of the scenario's table `plugins.parameters`, or `default` if it is missing.
    #[must_use]
    #[expect(unsafe_code, reason = "the host's C strings")]
    pub fn parameter(&self, name: &str, default: f64) -> f64 {
        // SAFETY: the host hands over that many marks, and one more.
        let asked = unsafe { std::slice::from_raw_parts(self.0.asked, self.0.parameter_count + 1) };
        asked[self.0.parameter_count].set(1);
        if self.0.parameter_count == 0 {
            return default;
        }
        // SAFETY: the host hands that many parameters over, each with a name.
        let parameters = unsafe { std::slice::from_raw_parts(self.0.parameters, self.0.parameter_count) };
        let is_it = |parameter: &abi::Parameter| {
            // SAFETY: as above.
            unsafe { CStr::from_ptr(parameter.name) }.to_bytes() == name.as_bytes()
        };
        let Some(index) = parameters.iter().position(is_it) else {
            return default;
        };
        asked[index].set(1);
        parameters[index].value
    }

    /// Returns the scenario.
    ///
    /// # Errors
    /// If library and host have different versions of the scenario.
    #[expect(unsafe_code, reason = "the host's C string")]
    pub fn scenario(&self) -> Result<Scenario, BuildError> {
        // SAFETY: the host hands a text over.
        let text = unsafe { CStr::from_ptr(self.0.scenario) };
        Ok(serde_json::from_slice(text.to_bytes())?)
    }
}

/// Exports a [`Plugin`] as the service of this library.
#[macro_export]
macro_rules! export {
    ($service:ty) => {
        /// Returns the service of this library.
        #[allow(
            unsafe_code,
            reason = "the name of the function is that of the interface"
        )]
        #[unsafe(no_mangle)]
        pub extern "C" fn gerono_plugin_v1() -> *const $crate::abi::Plugin {
            $crate::export::plugin::<$service>()
        }
    };
}

/// Returns the interface of a service, allocated for the life of the process.
#[must_use]
pub fn plugin<S: Plugin>() -> &'static abi::Plugin {
    let inputs = S::ID.inputs().iter().map(|input| input.topic);
    let topics = inputs.chain(S::ID.outputs().iter().map(|output| output.topic));
    let layouts: Vec<_> = topics.map(|topic| constant(&topic.layout_hash())).collect();
    let layouts = layouts.leak();
    Box::leak(Box::new(abi::Plugin {
        abi: abi::VERSION,
        size: u32::try_from(size_of::<abi::Plugin>()).expect("a small structure"),
        service: constant(S::ID.name()),
        layouts: layouts.as_ptr(),
        layout_count: layouts.len(),
        create: Some(create::<S>),
        step: Some(step::<S>),
        state_size: Some(state_size::<S>),
        save: Some(save::<S>),
        restore: Some(restore::<S>),
        destroy: Some(destroy::<S>),
    }))
}

fn constant(text: &str) -> *const c_char {
    CString::new(text).expect("a name without zero bytes").into_raw()
}

#[expect(unsafe_code, reason = "the interface is in C")]
unsafe extern "C" fn create<S: Plugin>(
    setup: *const abi::Setup,
    why_not: *mut c_char,
    size: usize,
) -> *mut c_void {
    // SAFETY: the host hands a setup over.
    let setup = Setup(unsafe { &*setup });
    let made = catch_unwind(AssertUnwindSafe(|| S::create(&setup)));
    let reason = match made {
        Ok(Ok(service)) => {
            let exported = Exported {
                service,
                is_broken: Cell::new(false),
            };
            return Box::into_raw(Box::new(exported)).cast();
        }
        Ok(Err(error)) => error.to_string(),
        Err(_) => "it panicked".to_owned(),
    };
    let length = reason.len().min(size.saturating_sub(1));
    // SAFETY: the host has room for `size` bytes, the last of which is 0 already.
    unsafe { std::ptr::copy_nonoverlapping(reason.as_ptr().cast(), why_not, length) };
    std::ptr::null_mut()
}

#[expect(unsafe_code, reason = "the interface is in C")]
unsafe extern "C" fn step<S: Plugin>(
    service: *mut c_void,
    now: *const abi::Now,
    inputs: *const abi::Input,
    outputs: *const abi::Output,
) -> c_int {
    // SAFETY: the host hands over what `create` made, the time, one view an input and one place an output.
    let (service, now) = unsafe { (&mut (*service.cast::<Exported<S>>()).service, &*now) };
    // SAFETY: as above.
    let inputs = unsafe { std::slice::from_raw_parts(inputs, S::ID.inputs().len()) };
    // SAFETY: as above.
    let outputs = unsafe { std::slice::from_raw_parts(outputs, S::ID.outputs().len()) };
    let now = Now {
        tick: now.tick,
        time_ns: now.time_ns,
        elapsed_ns: now.elapsed_ns,
        operator: Operator {
            armed: now.armed != 0,
            land: now.land != 0,
            killed: now.killed != 0,
            arm_count: now.arm_count,
        },
    };
    let mut views = [InputView::default(); MAX_PORTS];
    for ((view, input), spec) in views.iter_mut().zip(inputs).zip(S::ID.inputs()) {
        if !input.sample.is_null() {
            // SAFETY: a sample of the topic, whose layout the host has compared.
            let bytes = unsafe { std::slice::from_raw_parts(input.sample.cast(), spec.topic.kind().size) };
            (view.bytes, view.fresh) = (Some(bytes), input.fresh != 0);
        }
    }
    let mut slots: [OutputSlot<'_>; MAX_PORTS] = Default::default();
    for ((slot, output), spec) in slots.iter_mut().zip(outputs).zip(S::ID.outputs()) {
        if !output.sample.is_null() {
            let size = spec.topic.kind().size;
            // SAFETY: as above; the memory is not aliased.
            slot.bytes = Some(unsafe { std::slice::from_raw_parts_mut(output.sample.cast(), size) });
        }
    }
    let stepped = catch_unwind(AssertUnwindSafe(|| {
        let views = &views[..S::ID.inputs().len()];
        ErasedService::step(service, &now, views, &mut slots[..S::ID.outputs().len()]);
    }));
    // The panic hook has printed the message to standard error.
    stepped.is_err().into()
}

#[expect(unsafe_code, reason = "the interface is in C")]
unsafe extern "C" fn state_size<S: Plugin>(service: *const c_void) -> usize {
    // SAFETY: what `create` made.
    let exported = unsafe { &*service.cast::<Exported<S>>() };
    if exported.is_broken.get() {
        BROKEN
    } else {
        size_of::<S::State>()
    }
}

#[expect(unsafe_code, reason = "the interface is in C")]
unsafe extern "C" fn save<S: Plugin>(service: *const c_void, to: *mut c_void) {
    // SAFETY: what `create` made.
    let exported = unsafe { &*service.cast::<Exported<S>>() };
    match catch_unwind(AssertUnwindSafe(|| Service::save(&exported.service))) {
        // SAFETY: room for a state, aligned to 8.
        Ok(state) => unsafe { to.cast::<S::State>().write(state) },
        Err(_) => exported.is_broken.set(true),
    }
}

#[expect(unsafe_code, reason = "the interface is in C")]
unsafe extern "C" fn restore<S: Plugin>(service: *mut c_void, from: *const c_void) {
    // SAFETY: what `create` made, and a state that `save` wrote: every pattern of bits is one.
    let (exported, state) = unsafe { (&mut *service.cast::<Exported<S>>(), &*from.cast::<S::State>()) };
    if catch_unwind(AssertUnwindSafe(|| {
        Service::restore(&mut exported.service, state);
    }))
    .is_err()
    {
        exported.is_broken.set(true);
    }
}

#[expect(unsafe_code, reason = "the interface is in C")]
unsafe extern "C" fn destroy<S: Plugin>(service: *mut c_void) {
    // SAFETY: what `create` made; no other reference is left.
    let exported = unsafe { Box::from_raw(service.cast::<Exported<S>>()) };
    // The flight is over; the panic hook has printed the message to standard error.
    let _ = catch_unwind(AssertUnwindSafe(|| drop(exported)));
}
