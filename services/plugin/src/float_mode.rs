//! Floating-point mode of a thread: rounding, and whether subnormal numbers count as zero.
//!
//! A library that was linked with `-ffast-math` sets flush-to-zero in every thread that loads it, which would change the last
//! bits of all later results of the thread.

/// The mode of the calling thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FloatMode(u64);

/// Sticky exception flags, which are not part of the mode.
#[cfg(target_arch = "x86_64")]
const FLAGS: u64 = 0x3f;

/// Initial mode of processes: rounding to nearest, subnormal numbers, no traps.
#[cfg(target_arch = "x86_64")]
const STANDARD: u64 = 0x1f80;
#[cfg(not(target_arch = "x86_64"))]
const STANDARD: u64 = 0;

/// Sets the standard mode of a thread until it is dropped: other code of the process, such as a library loaded by an
/// interpreter, may have set another mode.
#[derive(Debug)]
pub struct StandardFloatMode(FloatMode);

impl StandardFloatMode {
    /// Sets the mode of the calling thread.
    #[must_use]
    pub fn enter() -> Self {
        let before = FloatMode::current();
        FloatMode(STANDARD).set();
        Self(before)
    }
}

impl Drop for StandardFloatMode {
    fn drop(&mut self) {
        self.0.set();
    }
}

impl FloatMode {
    /// Returns the mode of the calling thread.
    #[inline]
    #[must_use]
    pub fn current() -> Self {
        Self(register())
    }

    /// Sets the mode of the calling thread.
    pub fn set(self) {
        set_register(self.0);
    }
}

#[cfg(target_arch = "x86_64")]
#[inline]
#[expect(unsafe_code, reason = "MXCSR has no safe accessor")]
fn register() -> u64 {
    let mut value = 0u32;
    // SAFETY: stores the register into a local variable.
    unsafe { std::arch::asm!("stmxcsr [{}]", in(reg) &raw mut value, options(nostack, preserves_flags)) };
    u64::from(value) & !FLAGS
}

#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "MXCSR has no safe accessor")]
fn set_register(mode: u64) {
    let value = u32::try_from(mode).expect("it was read from a register of 32 bits");
    // SAFETY: the value was read from this register, so that no reserved bit is set.
    unsafe { std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const value, options(nostack, preserves_flags)) };
}

#[cfg(target_arch = "aarch64")]
#[inline]
#[expect(unsafe_code, reason = "FPCR has no safe accessor")]
fn register() -> u64 {
    let value: u64;
    // SAFETY: reads the register; its exception flags are in another one.
    unsafe { std::arch::asm!("mrs {}, fpcr", out(reg) value, options(nomem, nostack, preserves_flags)) };
    value
}

#[cfg(target_arch = "aarch64")]
#[expect(unsafe_code, reason = "FPCR has no safe accessor")]
fn set_register(mode: u64) {
    // SAFETY: the value was read from this register.
    unsafe { std::arch::asm!("msr fpcr, {}", in(reg) mode, options(nostack, preserves_flags)) };
}

/// On other architectures the mode cannot be read, and is assumed constant.
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn register() -> u64 {
    0
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn set_register(_mode: u64) {}
