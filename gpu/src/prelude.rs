//! The part of the standard library's prelude that the shared sources use.

pub use alloc::boxed::Box;
pub use alloc::string::{String, ToString};
pub use alloc::vec;
pub use alloc::vec::Vec;
pub use core::prelude::rust_2024::*;

/// Methods of f64 that the core library lacks. Square roots are correctly rounded in hardware.
pub trait Float {
    fn sqrt(self) -> f64;
    fn round(self) -> f64;
    fn ln(self) -> f64;
}

impl Float for f64 {
    #[inline(always)]
    fn sqrt(self) -> f64 {
        core::f64::math::sqrt(self)
    }
    #[inline(always)]
    fn round(self) -> f64 {
        libm::round(self)
    }
    fn ln(self) -> f64 {
        libm::log(self)
    }
}
