//! A cache of values that are expensive to compute, bounded by number and bytes.

use std::sync::{Arc, Mutex};

use lru::LruCache;

use crate::error::Result;
use crate::sync::lock;

/// Least-recently-used cache by key. Concurrent requests for a value wait for one computation.
pub struct BoundedCache<T> {
    limits: CacheLimits,
    entries: Mutex<LruCache<String, CacheEntry<T>>>,
}

/// Capacity of a cache. The most recently used value stays, whatever its size.
#[derive(Clone, Copy, Debug)]
pub struct CacheLimits {
    pub entries: usize,
    pub bytes: usize,
}

struct CacheEntry<T> {
    /// Size of the value; 0 until it is computed.
    bytes: usize,
    cell: ValueCell<T>,
}

/// Locked while the value is computed.
type ValueCell<T> = Arc<Mutex<Option<Arc<T>>>>;

impl<T> BoundedCache<T> {
    pub fn new(limits: CacheLimits) -> BoundedCache<T> {
        BoundedCache { limits, entries: Mutex::new(LruCache::unbounded()) }
    }

    /// The value of a key, computed by `make`, which also returns its size in bytes, if it is not cached.
    pub fn get(&self, key: &str, make: impl FnOnce() -> Result<(T, usize)>) -> Result<Arc<T>> {
        let new = || CacheEntry { bytes: 0, cell: Arc::default() };
        let cell = lock(&self.entries).get_or_insert(key.to_string(), new).cell.clone();
        let mut value = lock(&cell);
        if let Some(value) = &*value {
            return Ok(value.clone());
        }
        match make() {
            Ok((made, bytes)) => {
                let made = Arc::new(made);
                *value = Some(made.clone());
                self.record_size(key, &cell, bytes);
                Ok(made)
            }
            Err(error) => {
                let mut entries = lock(&self.entries);
                if entries.peek(key).is_some_and(|entry| Arc::ptr_eq(&entry.cell, &cell)) {
                    entries.pop(key);
                }
                Err(error)
            }
        }
    }

    /// Records a value's size and evicts entries beyond the capacity.
    fn record_size(&self, key: &str, cell: &ValueCell<T>, bytes: usize) {
        let mut entries = lock(&self.entries);
        if let Some(entry) = entries.peek_mut(key).filter(|entry| Arc::ptr_eq(&entry.cell, cell)) {
            entry.bytes = bytes;
        }
        let mut total: usize = entries.iter().map(|(_, entry)| entry.bytes).sum();
        while entries.len() > 1 && (entries.len() > self.limits.entries || total > self.limits.bytes) {
            total -= entries.pop_lru().map_or(0, |(_, entry)| entry.bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::error::Error;

    #[test]
    fn evicts_least_recently_used() {
        let all = BoundedCache::new(CacheLimits { entries: 2, bytes: 100 });
        let made = Cell::new(0);
        let get = |key: &str, bytes: usize| {
            let make = || {
                made.set(made.get() + 1);
                Ok((key.to_string(), bytes))
            };
            assert_eq!(*all.get(key, make).unwrap(), key);
            made.get()
        };
        assert_eq!([get("a", 40), get("b", 40), get("a", 40)], [1, 2, 2]);
        assert_eq!([get("c", 40), get("a", 40), get("b", 40)], [3, 3, 4], "b was the one to go");
        assert_eq!([get("large", 1000), get("large", 1000)], [5, 5], "whatever its size");
        assert_eq!([get("b", 40), get("a", 40), get("large", 7)], [6, 7, 8], "it goes with the next");
    }

    #[test]
    fn failed_computation_is_retried() {
        let all: BoundedCache<u32> = BoundedCache::new(CacheLimits { entries: 2, bytes: 100 });
        assert_eq!(all.get("a", || Err(Error::Cancelled)), Err(Error::Cancelled));
        assert_eq!(all.get("a", || Ok((7, 1))), Ok(Arc::new(7)));
        assert_eq!(lock(&all.entries).len(), 1);
    }

    #[test]
    fn concurrent_requests_share_one_computation() {
        let (all, made) = (BoundedCache::new(CacheLimits { entries: 2, bytes: 100 }), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    let make = || {
                        std::thread::yield_now();
                        Ok((made.fetch_add(1, Ordering::Relaxed), 1))
                    };
                    assert_eq!(*all.get("a", make).unwrap(), 0);
                });
            }
        });
        assert_eq!(made.into_inner(), 1);
    }
}
