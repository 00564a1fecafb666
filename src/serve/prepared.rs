//! What takes long to prepare and is asked again and again: kept as long as there is room, prepared again after that.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::error::Result;

/// Things by key, the least recently asked for first. Whoever asks for what is being prepared waits for it.
pub struct Prepared<T> {
    most: Most,
    kept: Mutex<Vec<Slot<T>>>,
}

/// How much is kept. What was asked for last is, whatever its size.
#[derive(Clone, Copy, Debug)]
pub struct Most {
    pub things: usize,
    pub bytes: usize,
}

struct Slot<T> {
    key: String,
    bytes: usize,
    thing: Arc<Mutex<Option<Arc<T>>>>,
}

impl<T> Prepared<T> {
    pub fn new(most: Most) -> Prepared<T> {
        Prepared { most, kept: Mutex::default() }
    }

    /// What goes by this key, prepared by `make`, which also tells its size in bytes, unless it is there.
    pub fn get(&self, key: &str, make: impl FnOnce() -> Result<(T, usize)>) -> Result<Arc<T>> {
        let place = self.place(key);
        let mut thing = locked(&place);
        if let Some(thing) = &*thing {
            return Ok(thing.clone());
        }
        match make() {
            Ok((made, bytes)) => {
                let made = Arc::new(made);
                *thing = Some(made.clone());
                self.fitted(&place, bytes);
                Ok(made)
            }
            Err(error) => {
                locked(&self.kept).retain(|slot| !Arc::ptr_eq(&slot.thing, &place));
                Err(error)
            }
        }
    }

    /// Where the thing of this key is, or is to be, which is now the one asked for last.
    fn place(&self, key: &str) -> Arc<Mutex<Option<Arc<T>>>> {
        let mut kept = locked(&self.kept);
        let slot = match kept.iter().position(|slot| slot.key == key) {
            Some(at) => kept.remove(at),
            None => Slot { key: key.into(), bytes: 0, thing: Arc::default() },
        };
        let place = slot.thing.clone();
        kept.push(slot);
        place
    }

    /// Notes a size, and lets go of what there is no room for.
    fn fitted(&self, place: &Arc<Mutex<Option<Arc<T>>>>, bytes: usize) {
        let mut kept = locked(&self.kept);
        if let Some(slot) = kept.iter_mut().find(|slot| Arc::ptr_eq(&slot.thing, place)) {
            slot.bytes = bytes;
        }
        let full = |kept: &[Slot<T>]| {
            kept.len() > self.most.things || kept.iter().map(|s| s.bytes).sum::<usize>() > self.most.bytes
        };
        while kept.len() > 1 && full(&kept) {
            kept.remove(0);
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::error::Error;

    #[test]
    fn what_was_asked_for_last_is_kept() {
        let all = Prepared::new(Most { things: 2, bytes: 100 });
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
    fn what_cannot_be_prepared_is_tried_again() {
        let all: Prepared<u32> = Prepared::new(Most { things: 2, bytes: 100 });
        assert_eq!(all.get("a", || Err(Error::Cancelled)), Err(Error::Cancelled));
        assert_eq!(all.get("a", || Ok((7, 1))), Ok(Arc::new(7)));
        assert_eq!(locked(&all.kept).len(), 1);
    }

    #[test]
    fn many_who_ask_at_once_wait_for_one() {
        let (all, made) = (Prepared::new(Most { things: 2, bytes: 100 }), AtomicUsize::new(0));
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
