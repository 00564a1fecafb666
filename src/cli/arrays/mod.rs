//! Arrays in NumPy's formats.

pub mod npy;
pub mod npz;
