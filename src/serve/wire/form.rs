//! The form of an answer.

/// JSON or msgpack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    Json,
    /// msgpack, with arrays as pieces of memory if `raw`.
    Msgpack {
        raw: bool,
    },
}

/// Media type of msgpack.
pub const MSGPACK: &str = "application/msgpack";

impl Form {
    /// Whether arrays are wanted apart.
    pub fn raw(self) -> bool {
        self == Form::Msgpack { raw: true }
    }
}
