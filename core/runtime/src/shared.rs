//! Values that several processes compute from the same texts, such as the world of a simulation: computed once, and in
//! memory once, as long as anyone holds them. Runs beside each other share them, too.

use std::any::Any;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

static KNOWN: Mutex<Vec<Entry>> = Mutex::new(Vec::new());

struct Entry {
    texts: Vec<String>,
    value: Arc<Value>,
}

/// Locked while it is computed, so that a second process waits for it.
type Value = Mutex<Option<Weak<dyn Any + Send + Sync>>>;

/// The value that `compute` makes of these texts; that of an earlier call while anyone holds it.
///
/// `compute` must depend on the texts alone, so that it does not matter which process calls it: the name of what is
/// computed is one of the texts. It must not call this function.
pub fn shared<T: Send + Sync + 'static, E>(
    texts: &[&str],
    compute: impl FnOnce() -> Result<T, E>,
) -> Result<Arc<T>, E> {
    let value = entry(texts);
    let mut value = lock(&value);
    let held = value.as_ref().and_then(Weak::upgrade).and_then(|held| held.downcast::<T>().ok());
    if let Some(held) = held {
        return Ok(held);
    }
    let computed = Arc::new(compute()?);
    let any: Arc<dyn Any + Send + Sync> = computed.clone();
    *value = Some(Arc::downgrade(&any));
    Ok(computed)
}

/// The entry of these texts. Others that nobody holds or computes are removed.
fn entry(texts: &[&str]) -> Arc<Value> {
    let mut known = lock(&KNOWN);
    if let Some(entry) = known.iter().find(|entry| entry.texts.iter().eq(texts)) {
        return Arc::clone(&entry.value);
    }
    known.retain(|entry| Arc::strong_count(&entry.value) > 1 || is_held(&entry.value));
    let value = Arc::default();
    let texts = texts.iter().map(|&text| text.to_owned()).collect();
    known.push(Entry { texts, value: Arc::clone(&value) });
    value
}

fn is_held(value: &Value) -> bool {
    lock(value).as_ref().is_some_and(|value| value.strong_count() > 0)
}

/// A panic while a value is computed leaves it as it was.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[test]
    fn a_value_is_computed_once_while_anyone_holds_it_and_again_after_that() {
        let count = AtomicU32::new(0);
        let compute = |texts: [&str; 2]| {
            shared(&texts, || {
                count.fetch_add(1, Ordering::Relaxed);
                std::thread::sleep(std::time::Duration::from_millis(20));
                Ok::<_, String>(texts.concat())
            })
            .unwrap()
        };
        let held = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(|| compute(["a of a test", "1"]))).collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect::<Vec<_>>()
        });
        assert!(held.iter().all(|value| Arc::ptr_eq(value, &held[0]) && **value == "a of a test1"));
        assert_eq!(count.load(Ordering::Relaxed), 1);
        assert_eq!(*compute(["a of a test", "2"]), "a of a test2");
        assert!(Arc::ptr_eq(&compute(["a of a test", "1"]), &held[0]));
        drop(held);
        compute(["a of a test", "1"]);
        assert_eq!(count.load(Ordering::Relaxed), 3);
    }

    #[test]
    fn an_error_is_returned_and_not_kept_and_another_type_is_another_value() {
        let texts = ["b of a test"];
        assert_eq!(shared(&texts, || Err::<u8, _>("no")), Err("no"));
        let number = shared(&texts, || Ok::<_, String>(7_u8)).unwrap();
        let text = shared(&texts, || Ok::<_, String>("seven".to_owned())).unwrap();
        assert_eq!((*number, text.as_str()), (7, "seven"));
    }

    #[test]
    fn what_nobody_holds_is_forgotten() {
        let texts = ["c of a test"];
        drop(shared(&texts, || Ok::<_, String>(1_u8)).unwrap());
        let _other = shared(&["d of a test"], || Ok::<_, String>(2_u8)).unwrap();
        assert!(!lock(&KNOWN).iter().any(|entry| entry.texts.iter().eq(&texts)));
    }
}
