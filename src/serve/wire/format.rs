//! Serialisation format of a response.

/// JSON or msgpack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireFormat {
    Json,
    /// msgpack, with binary arrays if `raw`.
    Msgpack {
        raw: bool,
    },
}

/// Media type of msgpack.
pub const MSGPACK: &str = "application/msgpack";

impl WireFormat {
    /// Whether the client accepts binary arrays.
    pub fn raw(self) -> bool {
        self == WireFormat::Msgpack { raw: true }
    }
}
