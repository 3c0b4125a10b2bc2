//! Loader of services from shared libraries.
//!
//! The library runs in the process of its service, or in that of the host. It is called with copies of the samples, so that
//! it cannot alter those of others, and writes between guard words. After each call the floating-point mode is restored. A
//! violation ends the process, which is restarted as after any other death, or the flight in one process; that step
//! publishes nothing. A second instance verifies periodically that the saved state is complete (`Trial`).

mod trial;

use std::cell::RefCell;
use std::ffi::{CStr, c_char, c_void};
use std::path::{Path, PathBuf};

use libloading::{Library, Symbol};
use scenario::Scenario;
use shared_types::checkpoint::CAPACITY;
use shared_types::samples::ControlCommand;
use shared_types::schedule::MAX_PORTS;
use shared_types::service::{Built, ErasedService, InputView, OutputSlot};
use shared_types::{Header, Now, ServiceId, Topic};
use zerocopy::FromBytes;

use crate::abi;
use crate::calls::{self, Call, FloatModeChanged, Living};
use crate::guarded::Guarded;
use crate::setup_texts::SetupTexts;
use trial::Trial;

/// Size of the buffer for the reason of a failed creation, bytes.
const REASON: usize = 512;

/// Error of a library that cannot fly.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The system cannot load it.
    #[error("`{}` cannot be loaded: {reason}", path.display())]
    NotLoaded {
        /// The library.
        path: PathBuf,
        /// The reason that the system gives.
        reason: String,
    },
    /// It changes the floating-point mode of the thread that loads it.
    #[error(
        "`{}` changes the floating-point mode in its {function}, which would change the last bits of all numbers: link it \
         without -ffast-math and -Ofast, and let its functions leave the mode as it is",
        path.display()
    )]
    FloatMode {
        /// The library.
        path: PathBuf,
        /// The function.
        function: &'static str,
    },
    /// It does not fulfil the interface.
    #[error("`{}` cannot fly as `{role}`: {reason}", path.display())]
    Interface {
        /// The library.
        path: PathBuf,
        /// The expected role.
        role: ServiceId,
        /// What is wrong, with the fix.
        reason: String,
    },
    /// It does not support the scenario.
    #[error("`{}` refuses the scenario: {reason}", path.display())]
    Refused {
        /// The library.
        path: PathBuf,
        /// The reason that it gives.
        reason: String,
    },
}

/// Functions of a library, checked to exist.
#[derive(Clone, Copy)]
struct Functions {
    state_size: unsafe extern "C" fn(*const c_void) -> usize,
    step: unsafe extern "C" fn(
        *mut c_void,
        *const abi::Now,
        *const abi::Input,
        *const abi::Output,
    ) -> std::ffi::c_int,
    save: unsafe extern "C" fn(*const c_void, *mut c_void),
    restore: unsafe extern "C" fn(*mut c_void, *const c_void),
    destroy: unsafe extern "C" fn(*mut c_void),
}

thread_local! {
    /// Report on the last service of this thread whose `destroy` did not return.
    static HUNG: RefCell<Option<String>> = const { RefCell::new(None) };
    /// Parameters that its library has not requested, for each service created by this thread.
    static UNASKED: RefCell<Vec<Vec<String>>> = const { RefCell::new(Vec::new()) };
}

/// Returns the parameters that none of the libraries loaded by this thread since the last call has requested.
#[must_use]
pub fn take_unasked() -> Vec<String> {
    let unasked = UNASKED.take();
    let (first, others) = unasked
        .split_first()
        .map_or((&[][..], &[][..]), |(first, others)| (&first[..], others));
    let is_unasked = |name: &&String| others.iter().all(|other| other.contains(name));
    first.iter().filter(is_unasked).cloned().collect()
}

/// Takes the report on a dropped service of this thread whose `destroy` did not return, if any.
#[must_use]
pub fn take_hung_destroy() -> Option<String> {
    HUNG.take()
}

/// Instance of a library, sent to the thread that frees it.
struct Instance(*mut c_void);

// SAFETY: as for [`PluginService`].
#[expect(unsafe_code, reason = "the library's service is behind a raw pointer")]
unsafe impl Send for Instance {}

/// Service of a library.
struct PluginService {
    role: ServiceId,
    /// The library and its role, for messages.
    call: Call,
    functions: Functions,
    /// Instance of the library.
    instance: *mut c_void,
    inputs: Vec<Guarded>,
    outputs: Vec<Guarded>,
    state: RefCell<Guarded>,
    state_size: usize,
    /// `true` if the vehicle takes body rates, not torques.
    has_rates: bool,
    /// Verification of the saved state; `None` in the second instance.
    trial: Option<Box<Trial>>,
    /// Counts the service, for the detection of `exit`.
    _living: Living,
}

/// Inputs and outputs of a step with a sample: bit i for port i.
#[derive(Clone, Copy, Default)]
struct Ports {
    delivered: u32,
    fresh: u32,
    due: u32,
}

// SAFETY: a host calls a service from one thread at a time, and the interface promises that a service may move between
// threads.
#[expect(unsafe_code, reason = "the library's service is behind a raw pointer")]
unsafe impl Send for PluginService {}

/// Loads a library and makes its service for a scenario.
///
/// # Errors
/// [`LoadError`].
pub fn load(role: ServiceId, path: &Path, scenario: &Scenario) -> Built {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let call = Call {
        // A library is never unloaded either.
        library: name.into_owned().leak(),
        role,
        function: "initialisation",
        is_set_up: true,
    };
    calls::guard_exit();
    let plugin = call
        .make(|| open(path))
        .map_err(|changed| float_mode(path, changed))??;
    let mut service = PluginService::new(call, path, plugin, scenario)?;
    let second = PluginService::new(call, path, plugin, scenario)?;
    service.trial = Some(Box::new(Trial::new(second)));
    Ok(Box::new(service))
}

fn float_mode(path: &Path, FloatModeChanged { function }: FloatModeChanged) -> LoadError {
    LoadError::FloatMode {
        path: path.to_owned(),
        function,
    }
}

/// Loads a library for the life of the process: its code must not be unloaded while one of its threads runs.
#[expect(unsafe_code, reason = "the library's code runs")]
fn open(path: &Path) -> Result<&'static abi::Plugin, LoadError> {
    let not_loaded = |error: libloading::Error| LoadError::NotLoaded {
        path: path.to_owned(),
        reason: error.to_string(),
    };
    // SAFETY: the initialisers run; the user trusts the library by naming it.
    let library = unsafe { Library::new(path) };
    let library: &'static Library = Box::leak(Box::new(library.map_err(not_loaded)?));
    // SAFETY: the interface gives the function this type.
    let entry: Symbol<'static, abi::Entry> =
        unsafe { library.get(abi::ENTRY.as_bytes()) }.map_err(not_loaded)?;
    // SAFETY: as above; it returns null or a constant of the library, which stays loaded.
    let plugin = unsafe { entry().as_ref() };
    plugin.ok_or_else(|| LoadError::NotLoaded {
        path: path.to_owned(),
        reason: format!("`{}` returns NULL", abi::ENTRY),
    })
}

/// Returns a text of a library; `None` for null.
#[expect(unsafe_code, reason = "C strings")]
fn text(pointer: *const c_char) -> Option<String> {
    // SAFETY: the interface demands a text that ends with a zero byte.
    (!pointer.is_null()).then(|| unsafe { CStr::from_ptr(pointer) }.to_string_lossy().into_owned())
}

/// Returns the texts of a list of a library.
#[expect(unsafe_code, reason = "C arrays")]
fn texts(list: *const *const c_char, count: usize) -> Vec<Option<String>> {
    if list.is_null() {
        return Vec::new();
    }
    // SAFETY: the interface demands that many texts.
    let list = unsafe { std::slice::from_raw_parts(list, count) };
    list.iter().map(|&pointer| text(pointer)).collect()
}

/// Returns the topics of a service's inputs, then of its outputs.
fn topics(role: ServiceId) -> impl Iterator<Item = Topic> {
    let inputs = role.inputs().iter().map(|input| input.topic);
    inputs.chain(role.outputs().iter().map(|output| output.topic))
}

/// Checks version, role and layouts of a library.
fn check(role: ServiceId, plugin: &abi::Plugin) -> Result<(), String> {
    if plugin.abi != abi::VERSION || plugin.size as usize != size_of::<abi::Plugin>() {
        return Err(format!(
            "it was built for version {} of the interface with a structure of {} bytes, and this program has version {} \
             with {} bytes: build it with the header of `gerono header`",
            plugin.abi,
            plugin.size,
            abi::VERSION,
            size_of::<abi::Plugin>()
        ));
    }
    let service = text(plugin.service).unwrap_or_default();
    if service != role.name() {
        return Err(format!("it is a `{service}`"));
    }
    let layouts = texts(plugin.layouts, plugin.layout_count);
    let expected: Vec<_> = topics(role).collect();
    if layouts.len() != expected.len() {
        return Err(format!(
            "it names {} layouts for {} inputs and outputs: build it with the header of `gerono header`",
            layouts.len(),
            expected.len()
        ));
    }
    for (layout, topic) in layouts.into_iter().zip(expected) {
        if layout.as_deref() != Some(&topic.layout_hash()) {
            return Err(format!(
                "it was built for another layout of `{topic}`: build it with the header of `gerono header`"
            ));
        }
    }
    Ok(())
}

impl PluginService {
    #[expect(unsafe_code, reason = "the library makes its service")]
    fn new(call: Call, path: &Path, plugin: &abi::Plugin, scenario: &Scenario) -> Result<Self, LoadError> {
        let role = call.role;
        let interface = |reason| LoadError::Interface {
            path: path.to_owned(),
            role,
            reason,
        };
        check(role, plugin).map_err(interface)?;
        let missing = || interface("a function of the interface is missing".to_owned());
        let create = plugin.create.ok_or_else(missing)?;
        let functions = Functions {
            step: plugin.step.ok_or_else(missing)?,
            state_size: plugin.state_size.ok_or_else(missing)?,
            save: plugin.save.ok_or_else(missing)?,
            restore: plugin.restore.ok_or_else(missing)?,
            destroy: plugin.destroy.ok_or_else(missing)?,
        };
        let stated = SetupTexts::new(scenario);
        let mut reason = [0u8; REASON];
        let creation = Call {
            function: "`create`",
            ..call
        };
        let changed = |changed| float_mode(path, changed);
        let instance = creation.make(|| {
            stated.with(|setup| {
                // SAFETY: the texts outlive the call, and the reason has the stated size.
                unsafe { create(setup, reason.as_mut_ptr().cast(), REASON) }
            })
        });
        let instance = instance.map_err(changed)?;
        if instance.is_null() {
            let end = reason.iter().position(|&byte| byte == 0).unwrap_or(REASON);
            let reason = String::from_utf8_lossy(&reason[..end]).into_owned();
            return Err(LoadError::Refused {
                path: path.to_owned(),
                reason,
            });
        }
        let sizing = Call {
            function: "`state_size`",
            ..creation
        };
        UNASKED.with_borrow_mut(|unasked| unasked.push(stated.unasked()));
        // SAFETY: the library made the instance.
        let state_size = sizing.make(|| unsafe { (functions.state_size)(instance) });
        let state_size = state_size.map_err(changed)?;
        let memory = |topic: Topic| Guarded::new(topic.kind().size);
        let service = Self {
            role,
            call: Call {
                function: "step",
                is_set_up: false,
                ..call
            },
            functions,
            instance,
            inputs: role.inputs().iter().map(|input| memory(input.topic)).collect(),
            outputs: role.outputs().iter().map(|output| memory(output.topic)).collect(),
            state: RefCell::new(Guarded::new(state_size.min(CAPACITY))),
            state_size,
            trial: None,
            has_rates: scenario.controller.rates.is_some(),
            _living: Living::begin(),
        };
        if state_size > CAPACITY {
            return Err(interface(format!(
                "its state has {} bytes, and a checkpoint holds 0 to {CAPACITY}: let `state_size` return the size of the \
                 state",
                // Shown as signed: a library may return a negative number.
                state_size.cast_signed()
            )));
        }
        Ok(service)
    }

    /// Calls a function of the library.
    #[inline]
    fn make<R>(&self, function: &'static str, act: impl FnOnce() -> R) -> R {
        let call = Call {
            function,
            ..self.call
        };
        match call.make(act) {
            Ok(result) => result,
            Err(FloatModeChanged { function }) => {
                self.fail(&format!("changed the floating-point mode in its {function}"))
            }
        }
    }

    /// Ends the process or the flight by a panic.
    #[cold]
    fn fail(&self, reason: &str) -> ! {
        panic!("{}", self.complaint(reason))
    }

    fn complaint(&self, reason: &str) -> String {
        format!(
            "the plug-in `{}` in place of `{}` {reason}",
            self.call.library, self.role
        )
    }

    /// Copies inputs and outputs of a step into this service's memory.
    #[inline]
    fn copy_ports(&mut self, inputs: &[InputView<'_>], outputs: &[OutputSlot<'_>]) -> Ports {
        let mut ports = Ports::default();
        for (index, (view, copy)) in inputs.iter().zip(&mut self.inputs).enumerate() {
            if let Some(bytes) = view.bytes {
                copy.bytes_mut().copy_from_slice(bytes);
                ports.delivered |= 1 << index;
                ports.fresh |= u32::from(view.fresh) << index;
            }
        }
        for (index, (slot, place)) in outputs.iter().zip(&mut self.outputs).enumerate() {
            if let Some(bytes) = &slot.bytes {
                place.bytes_mut().copy_from_slice(bytes);
                ports.due |= 1 << index;
            }
        }
        ports
    }

    /// Executes a step in this service's memory.
    #[inline]
    #[expect(unsafe_code, reason = "the library steps")]
    fn step_in_memory(&mut self, now: &abi::Now, ports: Ports) {
        let has = |bits: u32, index: usize| bits >> index & 1 != 0;
        let mut seen = [abi::Input {
            sample: std::ptr::null(),
            fresh: 0,
        }; MAX_PORTS];
        for (index, (seen, copy)) in seen.iter_mut().zip(&self.inputs).enumerate() {
            if has(ports.delivered, index) {
                seen.sample = copy.bytes().as_ptr().cast();
                seen.fresh = has(ports.fresh, index).into();
            }
        }
        let mut due = [abi::Output {
            sample: std::ptr::null_mut(),
        }; MAX_PORTS];
        for (index, (due, place)) in due.iter_mut().zip(&mut self.outputs).enumerate() {
            if has(ports.due, index) {
                due.sample = place.bytes_mut().as_mut_ptr().cast();
            }
        }
        // SAFETY: the instance is the library's own, and all memory outlives the call.
        let failure = self.make("step", || unsafe {
            (self.functions.step)(self.instance, now, seen.as_ptr(), due.as_ptr())
        });
        if failure != 0 {
            self.fail(&format!("returned {failure} from its step at tick {}", now.tick));
        }
        if !self.outputs.iter().all(Guarded::is_intact) {
            self.fail("wrote beyond a sample in its step");
        }
    }

    /// Checks that a controller commands what the vehicle takes: anything else would stop the motors.
    #[inline]
    fn check_mode(&self, tick: u64, ports: Ports) {
        let is_due = self.role == ServiceId::Controller && ports.due & 1 != 0;
        let command = ControlCommand::ref_from_bytes(self.outputs[0].bytes());
        if let Ok(command) = command
            && is_due
        {
            match (command.mode, self.has_rates) {
                (ControlCommand::MODE_TORQUE, true) => self.fail(&format!(
                    "commands a torque at tick {tick}, but the scenario has `[controller.rates]`, so its vehicle takes body \
                     rates: write `rates_body`, and `mode` 1"
                )),
                (ControlCommand::MODE_RATES, false) => self.fail(&format!(
                    "commands body rates at tick {tick}, but the scenario has no `[controller.rates]`, so its vehicle takes \
                     torques: write `torque_body`, and `mode` 0"
                )),
                _ => {}
            }
        }
    }

    /// Checks that the size of the state is unchanged: a Rust library reports a panic by another size.
    #[expect(unsafe_code, reason = "the library tells the size of its state")]
    fn check_state_size(&self, function: &str) {
        // SAFETY: the library made the instance.
        let size = self.make("`state_size`", || unsafe {
            (self.functions.state_size)(self.instance)
        });
        if size != self.state_size {
            self.fail(&format!(
                "panicked in its {function}, or has a state of another size since: {} bytes and not {}",
                size.cast_signed(),
                self.state_size
            ));
        }
    }
}

impl ErasedService for PluginService {
    fn id(&self) -> ServiceId {
        self.role
    }

    fn step(&mut self, now: &Now, inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        let now = abi::Now {
            tick: now.tick,
            time_ns: now.time_ns,
            elapsed_ns: now.elapsed_ns,
            armed: now.operator.armed.into(),
            land: now.operator.land.into(),
            killed: now.operator.killed.into(),
            arm_count: now.operator.arm_count,
            pad: [0; 4],
        };
        if let Some(mut trial) = self.trial.take() {
            trial.prepare(self, &now, inputs, outputs);
            self.trial = Some(trial);
        }
        let ports = self.copy_ports(inputs, outputs);
        self.step_in_memory(&now, ports);
        self.check_mode(now.tick, ports);
        for (slot, place) in outputs.iter_mut().zip(&self.outputs) {
            if let Some(bytes) = &mut slot.bytes {
                // Only the host writes the header.
                bytes[size_of::<Header>()..].copy_from_slice(&place.bytes()[size_of::<Header>()..]);
            }
        }
    }

    fn has_trials(&self) -> bool {
        true
    }

    fn try_saved_state(&mut self) -> Result<(), String> {
        let Some(mut trial) = self.trial.take() else {
            return Ok(());
        };
        let tried = trial.repeat(self);
        self.trial = Some(trial);
        tried.map_err(|difference| self.complaint(&difference))
    }

    fn state_size(&self) -> usize {
        self.state_size
    }

    #[expect(unsafe_code, reason = "the library writes its state")]
    fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
        let mut state = self.state.borrow_mut();
        let place = state.bytes_mut().as_mut_ptr().cast();
        // SAFETY: the memory has the size that the library stated.
        self.make("`save`", || unsafe {
            (self.functions.save)(self.instance, place);
        });
        if !state.is_intact() {
            self.fail("wrote beyond its state");
        }
        self.check_state_size("`save`");
        keep(state.bytes());
    }

    #[expect(unsafe_code, reason = "the library reads its state")]
    fn restore(&mut self, bytes: &[u8]) {
        if bytes.len() != self.state_size {
            self.fail(&format!(
                "gave a state of {} bytes, and now states a size of {}: `state_size` must return the same for each \
                 service of a scenario",
                bytes.len(),
                self.state_size
            ));
        }
        let mut state = self.state.borrow_mut();
        state.bytes_mut().copy_from_slice(bytes);
        let place = state.bytes().as_ptr().cast();
        // SAFETY: these are a state's bytes, aligned to 8.
        self.make("`restore`", || unsafe {
            (self.functions.restore)(self.instance, place);
        });
        drop(state);
        self.check_state_size("`restore`");
    }
}

impl Drop for PluginService {
    #[expect(unsafe_code, reason = "the library frees its service")]
    fn drop(&mut self) {
        if self.instance.is_null() {
            return;
        }
        // Both instances are freed within one timeout.
        let second = self.trial.as_mut().map(|trial| trial.take_instance());
        // A library may return the same instance twice.
        let second = second.filter(|&second| second != self.instance);
        let instances = std::iter::once(self.instance).chain(second);
        let instances: Vec<_> = instances.map(Instance).collect();
        let destroy = self.functions.destroy;
        let call = Call {
            function: "`destroy`",
            ..self.call
        };
        let has_returned = call.make_within_limit(move || {
            for Instance(instance) in instances {
                // SAFETY: the library made the instance, and no other reference to it is left.
                unsafe { destroy(instance) };
            }
        });
        if !has_returned {
            HUNG.set(Some(format!(
                "`destroy` of the plug-in `{}` in place of `{}` has not returned for 20 s",
                self.call.library, self.role
            )));
        }
    }
}
