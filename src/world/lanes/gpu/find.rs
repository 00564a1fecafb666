//! The graphics processor of this machine.

use std::sync::OnceLock;

use super::accelerator::Accelerator;
use super::measured_speed::MeasuredSpeed;
use crate::error::{Error, Result};

/// A graphics processor and how fast it was.
pub struct Device {
    pub accelerator: Box<dyn Accelerator + Send>,
    pub speed: MeasuredSpeed,
}

/// The graphics processor of this machine; an error says why there is none.
pub fn find() -> Result<&'static Device> {
    static FOUND: OnceLock<std::result::Result<Device, String>> = OnceLock::new();
    let open = || open().map(|accelerator| Device { accelerator, speed: MeasuredSpeed::default() });
    FOUND.get_or_init(open).as_ref().map_err(|reason| {
        Error::input(
            "engine",
            "\"gpu\"",
            format!(
                "\"auto\", \"lanes\" or \"rapier\": this machine has no graphics processor that can be used ({reason})"
            ),
        )
    })
}

/// Whether a driver is installed: much quicker than [`find`].
pub fn is_installed() -> bool {
    static INSTALLED: OnceLock<bool> = OnceLock::new();
    *INSTALLED.get_or_init(has_driver)
}

#[cfg(target_os = "linux")]
fn has_driver() -> bool {
    super::cuda::load_driver().is_some()
}

#[cfg(not(target_os = "linux"))]
fn has_driver() -> bool {
    false
}

#[cfg(target_os = "linux")]
fn open() -> std::result::Result<Box<dyn Accelerator + Send>, String> {
    super::cuda::Cuda::open().map(|cuda| Box::new(cuda) as Box<dyn Accelerator + Send>)
}

#[cfg(not(target_os = "linux"))]
fn open() -> std::result::Result<Box<dyn Accelerator + Send>, String> {
    Err("only Linux is supported".into())
}
