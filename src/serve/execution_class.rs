//! Execution classes: where and with which permit a request runs.

/// Bodies up to this size are parsed on the async threads, in at most about a millisecond; larger ones with a permit of class compute.
pub const MAX_INLINE_BODY_BYTES: usize = 64 * 1024;

/// Cost of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExecutionClass {
    /// Runs on the async threads: a fraction of a millisecond, without disk access.
    Inline,
    /// Runs on a blocking thread; waits for the disk at most.
    Blocking,
    /// Simulates, ranks or draws.
    Compute,
    /// As `Compute`, with a large response: JSON is streamed.
    Streaming,
}

impl ExecutionClass {
    /// Whether it occupies a core.
    pub fn computes(self) -> bool {
        matches!(self, ExecutionClass::Compute | ExecutionClass::Streaming)
    }
}
