//! Limits the bytes of request bodies that the server holds, in total and per client: bodies that are arriving, and those whose
//! requests are not answered yet.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use super::client::Client;
use crate::sync::lock;

/// Counts the bytes held for each client.
#[derive(Default)]
pub struct ByteLimiter {
    counts: Mutex<ByteCounts>,
}

#[derive(Default)]
struct ByteCounts {
    total: u64,
    by_client: HashMap<Client, u64>,
}

/// Maximum number of bytes held at a time.
#[derive(Clone, Copy)]
pub struct ByteCapacity {
    pub total: u64,
    pub per_client: u64,
}

/// Bytes of one request, which grow as they arrive; released when dropped.
pub struct BytePermit {
    limiter: Arc<ByteLimiter>,
    client: Client,
    capacity: ByteCapacity,
    bytes: u64,
}

impl ByteLimiter {
    /// A permit for no bytes yet.
    pub fn permit(self: &Arc<ByteLimiter>, client: &Client, capacity: ByteCapacity) -> BytePermit {
        BytePermit { limiter: self.clone(), client: client.clone(), capacity, bytes: 0 }
    }
}

impl BytePermit {
    /// Adds bytes; false, without adding them, if the client or all clients together would hold too many.
    pub fn grow(&mut self, bytes: usize) -> bool {
        let bytes = bytes as u64;
        let mut counts = lock(&self.limiter.counts);
        let own = counts.by_client.get(&self.client).copied().unwrap_or(0);
        if own + bytes > self.capacity.per_client || counts.total + bytes > self.capacity.total {
            return false;
        }
        counts.total += bytes;
        *counts.by_client.entry(self.client.clone()).or_default() += bytes;
        self.bytes += bytes;
        true
    }
}

impl Drop for BytePermit {
    fn drop(&mut self) {
        let mut counts = lock(&self.limiter.counts);
        counts.total -= self.bytes;
        if let Some(own) = counts.by_client.get_mut(&self.client) {
            *own -= self.bytes;
            if *own == 0 {
                counts.by_client.remove(&self.client);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_bytes_of_one_client_and_of_all() {
        let limiter = Arc::new(ByteLimiter::default());
        let client = |n: u8| Client::at([10, 0, 0, n].into());
        let permit = |n| limiter.permit(&client(n), ByteCapacity { total: 100, per_client: 60 });
        let (mut first, mut second, mut other) = (permit(1), permit(1), permit(2));
        assert!(first.grow(40) && second.grow(20) && !second.grow(1));
        assert!(other.grow(40) && !other.grow(1));
        drop(first);
        assert!(second.grow(40) && !second.grow(1) && !other.grow(1));
        drop((second, other));
        assert!(lock(&limiter.counts).by_client.is_empty() && lock(&limiter.counts).total == 0);
    }
}
