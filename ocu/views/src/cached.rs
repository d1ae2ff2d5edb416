//! Values that are computed again only when their messages change.

use rcs_msg::AnyMessage;

/// A message compared by identity: equal only to itself.
#[derive(Clone, Debug)]
pub(crate) struct SameMessage(pub(crate) AnyMessage);

impl PartialEq for SameMessage {
    fn eq(&self, other: &Self) -> bool {
        self.0.same(&other.0)
    }
}

/// A value computed from messages, cached until the key changes.
pub(crate) struct Cached<K, V> {
    entry: Option<(K, V)>,
}

impl<K, V> Default for Cached<K, V> {
    fn default() -> Self {
        Self { entry: None }
    }
}

impl<K: PartialEq, V> Cached<K, V> {
    /// The value for `key`, computed if the key differs from the previous call.
    pub(crate) fn get(&mut self, key: K, make: impl FnOnce() -> V) -> &mut V {
        let entry = self.entry.take().filter(|(old, _)| *old == key);
        &mut self.entry.insert(entry.unwrap_or_else(|| (key, make()))).1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_computed_once_for_each_key() {
        let mut cached = Cached::default();
        let mut count = 0;
        for key in [1, 1, 2, 2, 1] {
            cached.get(key, || count += 1);
        }
        assert_eq!(count, 3);
    }
}
