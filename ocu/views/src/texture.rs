//! Textures that are rebuilt only when their content changes.

use egui::{ColorImage, Context, TextureHandle, TextureOptions};
use rcs_msg::AnyMessage;

/// A message compared by identity: equal only to itself.
#[derive(Clone, Debug)]
pub(crate) struct SameMessage(pub(crate) AnyMessage);

impl PartialEq for SameMessage {
    fn eq(&self, other: &Self) -> bool {
        self.0.same(&other.0)
    }
}

/// A texture and the key of its content.
pub(crate) struct CachedTexture<K> {
    key: Option<K>,
    handle: Option<TextureHandle>,
}

impl<K> Default for CachedTexture<K> {
    fn default() -> Self {
        Self { key: None, handle: None }
    }
}

impl<K: PartialEq> CachedTexture<K> {
    /// The texture for `key`; `make` paints it if the key differs from the previous call.
    pub(crate) fn get(
        &mut self,
        ctx: &Context,
        key: K,
        options: TextureOptions,
        make: impl FnOnce() -> Option<ColorImage>,
    ) -> Option<&TextureHandle> {
        if self.key.as_ref() != Some(&key) {
            self.key = Some(key);
            match (make(), &mut self.handle) {
                (Some(image), Some(handle)) if handle.size() == image.size => handle.set(image, options),
                (Some(image), handle) => *handle = Some(ctx.load_texture("view", image, options)),
                (None, handle) => *handle = None,
            }
        }
        self.handle.as_ref()
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

    #[test]
    fn a_texture_is_painted_only_when_its_message_changes() {
        let ctx = Context::default();
        let mut texture = CachedTexture::default();
        let message = |x| AnyMessage::new(rcs_msg::foxglove::Vector2 { x, y: 0.0 });
        let (a, b) = (message(1.0), message(1.0));
        let mut painted = 0;
        for message in [&a, &a, &b, &b] {
            texture.get(&ctx, SameMessage(message.clone()), TextureOptions::NEAREST, || {
                painted += 1;
                Some(ColorImage::filled([2, 2], egui::Color32::RED))
            });
        }
        assert_eq!(painted, 2);
    }
}
