//! Laplacian of Gaussian (Albus 2006a, 3.1.1): removes brightness and its gradient from an image, and keeps texture.
//!
//! The Gaussian is the binomial kernel 1 4 6 4 1 in both directions, whose variance is 1 pixel²; the Laplacian uses
//! four neighbours; all in integers. The result is scaled, clipped to ±cap and stored as cap + value, one byte per
//! pixel. Clipping prevents a single strong edge from dominating a window.

#![allow(clippy::inline_always, reason = "kernels are compiled anew for each width of vectors")]
#![allow(clippy::needless_range_loop, reason = "loops over lanes index several slices alike")]

use crate::width::Kernel;

/// A filtered image. Each row has `pad` more columns at its left end and `pad + spare` at its right end, which are
/// copies of the outermost pixels of the row.
#[derive(Clone, Debug, Default)]
pub(crate) struct Filtered {
    pub(crate) height: usize,
    pub(crate) stride: usize,
    pub(crate) data: Vec<u8>,
    /// The Gaussian alone in steps of 4 grey levels, in the same layout; empty unless requested.
    pub(crate) brightness: Vec<u8>,
}

impl Filtered {
    /// A row with its padding; rows above and below the image are its first and last row.
    #[inline(always)]
    pub(crate) fn row(&self, y: isize) -> &[u8] {
        &self.data[self.row_start(y)..][..self.stride]
    }

    /// The same row of the smoothed brightness.
    #[inline(always)]
    pub(crate) fn brightness_row(&self, y: isize) -> &[u8] {
        &self.brightness[self.row_start(y)..][..self.stride]
    }

    #[inline(always)]
    fn row_start(&self, y: isize) -> usize {
        y.clamp(0, self.height as isize - 1) as usize * self.stride
    }
}

/// Filters an image of `width` columns.
pub(crate) struct LogFilter<'a> {
    pub(crate) image: &'a [u8],
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pad: usize,
    /// Number of columns at the right end that vectors may read and on which nothing depends.
    pub(crate) spare: usize,
    /// Largest absolute value; greater ones are clipped.
    pub(crate) cap: u8,
    /// Whether the smoothed brightness is computed, too.
    pub(crate) brightness: bool,
    pub(crate) out: &'a mut Filtered,
}

/// The filter result, in 1/16 grey level, is divided by 2 to this power.
const SHIFT: u32 = 2;

impl Kernel for LogFilter<'_> {
    #[inline(always)]
    fn run(self) {
        let LogFilter { image, width: w, height: h, pad, spare, cap, brightness, out } = self;
        out.height = h;
        out.stride = w + 2 * pad + spare;
        out.data.resize(out.stride * h, 0);
        out.brightness.resize(if brightness { out.stride * h } else { 0 }, 0);
        // Three rows of the Gaussian, with one more column at both ends for the Laplacian.
        let mut smooth = [vec![0_i16; w + 2], vec![0_i16; w + 2], vec![0_i16; w + 2]];
        let mut column = vec![0_u16; w + 4];
        let [above, here, below] = &mut smooth;
        gauss(image, [w, h], 0, &mut column, here);
        above.copy_from_slice(here);
        for y in 0..h {
            // The Gaussian's rows and columns are repeated beyond the image borders.
            gauss(image, [w, h], (y + 1).min(h - 1), &mut column, below);
            let row = &mut out.data[y * out.stride..][..out.stride];
            laplacian(above, here, below, i16::from(cap), &mut row[pad..][..w]);
            extend(row, pad, w);
            if brightness {
                let row = &mut out.brightness[y * out.stride..][..out.stride];
                quantise(&here[1..=w], &mut row[pad..][..w]);
                extend(row, pad, w);
            }
            std::mem::swap(above, here);
            std::mem::swap(here, below);
        }
    }
}

/// Copies the outermost pixels of a row into its padding.
#[inline(always)]
fn extend(row: &mut [u8], pad: usize, w: usize) {
    let (first, last) = (row[pad], row[pad + w - 1]);
    row[..pad].fill(first);
    row[pad + w..].fill(last);
}

/// Converts from 1/16 grey level to steps of 4.
#[inline(always)]
fn quantise(smooth: &[i16], out: &mut [u8]) {
    let n = out.len();
    let smooth = &smooth[..n];
    for i in 0..n {
        out[i] = (smooth[i] >> 6) as u8;
    }
}

#[inline(always)]
fn gauss(image: &[u8], [w, h]: [usize; 2], y: usize, column: &mut [u16], out: &mut [i16]) {
    let row = |y: usize| &image[y.min(h - 1) * w..][..w];
    let (a, b) = (row(y.saturating_sub(2)), row(y.saturating_sub(1)));
    smooth_columns(a, b, row(y), row(y + 1), row(y + 2), &mut column[2..w + 2]);
    let (first, last) = (column[2], column[w + 1]);
    column[..2].fill(first);
    column[w + 2..].fill(last);
    smooth_row(column, &mut out[1..=w]);
    out[0] = out[1];
    out[w + 1] = out[w];
}

#[inline(always)]
fn smooth_columns(a: &[u8], b: &[u8], c: &[u8], d: &[u8], e: &[u8], out: &mut [u16]) {
    let n = out.len();
    let (a, b, c, d, e) = (&a[..n], &b[..n], &c[..n], &d[..n], &e[..n]);
    for i in 0..n {
        let outer = u16::from(a[i]) + u16::from(e[i]);
        let inner = u16::from(b[i]) + u16::from(d[i]);
        out[i] = outer + 4 * inner + 6 * u16::from(c[i]);
    }
}

/// 16 times the smoothed grey level; fits in 12 bits.
#[inline(always)]
fn smooth_row(column: &[u16], out: &mut [i16]) {
    let n = out.len();
    let column = &column[..n + 4];
    for i in 0..n {
        // At most 16 · 16 · 255, which is less than 2¹⁶. Sums that are checked for overflow cannot be computed in vectors.
        let outer = column[i].wrapping_add(column[i + 4]);
        let inner = column[i + 1].wrapping_add(column[i + 3]);
        let sum = outer.wrapping_add(inner << 2).wrapping_add(column[i + 2].wrapping_mul(6));
        out[i] = (sum >> 4) as i16;
    }
}

#[inline(always)]
fn laplacian(above: &[i16], here: &[i16], below: &[i16], cap: i16, out: &mut [u8]) {
    let n = out.len();
    let (above, here, below) = (&above[..n + 2], &here[..n + 2], &below[..n + 2]);
    for i in 0..n {
        // Less than 2¹⁵, because smoothed grey levels fit in 12 bits.
        let across = above[i + 1].wrapping_add(below[i + 1]);
        let around = across.wrapping_add(here[i]).wrapping_add(here[i + 2]);
        let value = (here[i + 1] << 2).wrapping_sub(around) >> SHIFT;
        out[i] = (value.clamp(-cap, cap) + cap) as u8;
    }
}
