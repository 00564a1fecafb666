//! The graphics processor of this machine.

use std::sync::OnceLock;

use super::accelerator::Accelerator;
use crate::error::{Error, Result};

/// The graphics processor of this machine; an error says why there is none.
pub fn find() -> Result<&'static dyn Accelerator> {
    static FOUND: OnceLock<std::result::Result<Box<dyn Accelerator + Send>, String>> = OnceLock::new();
    match FOUND.get_or_init(open) {
        Ok(accelerator) => Ok(accelerator.as_ref()),
        Err(reason) => Err(Error::input(
            "engine",
            "\"gpu\"",
            format!(
                "\"auto\", \"lanes\" or \"rapier\": this machine has no graphics processor that can be used ({reason})"
            ),
        )),
    }
}

#[cfg(target_os = "linux")]
fn open() -> std::result::Result<Box<dyn Accelerator + Send>, String> {
    super::cuda::Cuda::open().map(|cuda| Box::new(cuda) as Box<dyn Accelerator + Send>)
}

#[cfg(not(target_os = "linux"))]
fn open() -> std::result::Result<Box<dyn Accelerator + Send>, String> {
    Err("only Linux is supported".into())
}
