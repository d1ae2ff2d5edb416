//! Pictures of models: what one was learned from, or the colours of its histogram where the message has no picture.

use crate::image::{self, Tint};
use crate::prepare::Painted;
use egui::{Color32, ColorImage, Context, Pos2, Rect, TextureId, TextureOptions, Vec2};
use rcs_msg::foxglove::RawImage;
use rcs_msg::{AnyMessage, Stamp, Value};

/// Greatest number of columns and rows of a picture; larger ones are reduced.
const MOST_PX: usize = 64;
/// Pictures in a row of the texture that holds all of them.
const COLUMNS: usize = 32;
/// Columns and rows of a swatch.
const SWATCH_PX: usize = 12;

/// A picture of a model.
#[derive(Debug)]
pub(super) struct Patch {
    pub(super) picture: ColorImage,
    /// When and by which camera it was taken; `None` for the colours of a histogram.
    pub(super) taken: Option<(Option<Stamp>, String)>,
}

impl Patch {
    /// The picture that a field of a model holds; `None` if the field is no image.
    pub(super) fn of(value: &Value) -> Option<Self> {
        let number = |name: &str| u32::try_from(value.field(name)?.as_f64()? as i64).ok();
        let text = |name: &str| match value.field(name)? {
            Value::Text(text) => Some(text.clone()),
            _ => None,
        };
        let Value::Bytes(data) = value.field("data")? else { return None };
        let (width, height) = (number("width")?, number("height")?);
        let encoding = text("encoding")?;
        let raw = RawImage {
            width,
            height,
            encoding,
            step: number("step")?,
            data: data.clone(),
            ..RawImage::default()
        };
        let decoded = image::decode(&AnyMessage::new(raw), None).ok()?;
        let range = decoded.value_range().unwrap_or([0.0, 1.0]);
        let time = value.field("timestamp").and_then(Value::as_stamp);
        let picture = decoded.paint(&Tint::Plain, range, MOST_PX);
        Some(Self { picture, taken: Some((time, text("frame_id").unwrap_or_default())) })
    }

    /// The colours of a histogram over red and green (its outer and its inner axis, with `columns` bins), each as often
    /// as in the histogram; `None` for other axes. Blue is not known, and is taken to be the lesser of the two, so that no
    /// colour looks more saturated than it is.
    pub(super) fn swatch([outer, inner]: &[String; 2], columns: usize, counts: &[f32]) -> Option<Self> {
        let columns = columns.max(1);
        let rows = counts.len() / columns;
        let sum: f64 = counts.iter().filter(|count| **count > 0.0).map(|count| f64::from(*count)).sum();
        if outer != "red" || inner != "green" || !(sum.is_finite() && sum > 0.0) {
            return None;
        }
        let level = |bin: usize, bins: usize| ((bin as f32 + 0.5) * 255.0 / bins as f32) as u8;
        let mut before = 0.0;
        let mut pixels = Vec::with_capacity(SWATCH_PX * SWATCH_PX);
        for (index, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0.0) {
            before += f64::from(*count);
            let (red, green) = (level(index / columns, rows), level(index % columns, columns));
            let until = (before / sum * (SWATCH_PX * SWATCH_PX) as f64).round() as usize;
            pixels.resize(until.max(pixels.len()), Color32::from_rgb(red, green, red.min(green)));
        }
        pixels.resize(SWATCH_PX * SWATCH_PX, pixels.last().copied()?);
        Some(Self { picture: ColorImage::new([SWATCH_PX; 2], pixels), taken: None })
    }
}

/// All pictures of a message in one image.
pub(super) struct Atlas {
    painted: Painted,
    /// Side of the square that each picture has in it, pixels.
    side: usize,
}

impl Atlas {
    /// The pictures of the models of a message, in their order; `None` if there is none.
    pub(super) fn new(patches: &[Option<&Patch>]) -> Option<Self> {
        let sides = patches.iter().flatten().map(|patch| patch.picture.size[0].max(patch.picture.size[1]));
        let side = sides.max()?;
        Some(Self { painted: Painted::new(paint(patches, side)), side })
    }

    /// The texture with all pictures, and its part with that of a model.
    pub(super) fn of(&self, ctx: &Context, index: usize, patch: &Patch) -> (TextureId, Rect) {
        let corner = Pos2::new((index % COLUMNS * self.side) as f32, (index / COLUMNS * self.side) as f32);
        let part = Rect::from_min_size(corner, size(patch.picture.size));
        let all = size(self.painted.size());
        let relative = |at: Pos2| Pos2::new(at.x / all.x, at.y / all.y);
        let texture = self.painted.texture(ctx, TextureOptions::NEAREST);
        (texture, Rect::from_min_max(relative(part.min), relative(part.max)))
    }
}

fn size([width, height]: [usize; 2]) -> Vec2 {
    Vec2::new(width as f32, height as f32)
}

fn paint(patches: &[Option<&Patch>], side: usize) -> ColorImage {
    let (columns, rows) = (patches.len().min(COLUMNS), patches.len().div_ceil(COLUMNS));
    let mut all = ColorImage::filled([columns * side, rows * side], Color32::TRANSPARENT);
    for (index, patch) in patches.iter().enumerate() {
        let Some(patch) = patch else { continue };
        let [width, _] = patch.picture.size;
        let corner = index / COLUMNS * side * all.size[0] + index % COLUMNS * side;
        for (row, line) in patch.picture.pixels.chunks_exact(width.max(1)).enumerate() {
            let begin = corner + row * all.size[0];
            all.pixels[begin..begin + width].copy_from_slice(line);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_that_is_an_image_is_a_picture_with_its_time_and_camera() {
        let field = |name: &str, value: Value| (name.to_owned(), value);
        let image = |bytes: usize| {
            Value::Message(vec![
                field("frame_id", Value::Text("camera".to_owned())),
                field("width", Value::Uint(2)),
                field("height", Value::Uint(1)),
                field("encoding", Value::Text("rgb8".to_owned())),
                field("step", Value::Uint(6)),
                field("data", Value::Bytes(vec![9; bytes].into())),
            ])
        };
        let patch = Patch::of(&image(6)).unwrap();
        assert_eq!((patch.picture.size, patch.picture.pixels[1]), ([2, 1], Color32::from_rgb(9, 9, 9)));
        assert_eq!(patch.taken, Some((None, "camera".to_owned())));
        assert!(Patch::of(&image(5)).is_none() && Patch::of(&Value::Uint(3)).is_none());
    }

    #[test]
    fn a_swatch_has_each_colour_as_often_as_the_histogram() {
        let mut counts = vec![0.0; 4];
        (counts[1], counts[2]) = (3.0, 1.0);
        let named = |outer: &str| Patch::swatch(&[outer.to_owned(), "green".to_owned()], 2, &counts);
        let swatch = named("red").unwrap().picture;
        let green = Color32::from_rgb(63, 191, 63);
        assert_eq!(
            swatch.pixels.iter().filter(|pixel| **pixel == green).count(),
            SWATCH_PX * SWATCH_PX * 3 / 4
        );
        assert!(named("range").is_none());
    }
}
