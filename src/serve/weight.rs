//! What a request costs, and so which turns it takes.

/// What doing it costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weight {
    /// A fraction of a millisecond without waiting for the disk, however it ends.
    Light,
    /// It waits for the disk at most.
    Usual,
    /// It simulates, ranks or draws.
    Heavy,
    /// The same, and the answer is large: as JSON it goes out piece by piece.
    Large,
}

impl Weight {
    /// Whether it takes a processor for as long as it lasts.
    pub fn computes(self) -> bool {
        matches!(self, Weight::Heavy | Weight::Large)
    }
}
