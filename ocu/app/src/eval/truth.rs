//! True disparities from files: PFM, 16-bit PNG in 1/256 pixel, or `NumPy`'s NPZ.
//!
//! Pixels, row by row from the top; not finite or not positive is unknown.

use crate::eval::npz;
use crate::usage;
use anyhow::Context as _;
use std::io::{BufRead, BufReader, Read as _};
use std::path::Path;

/// Reads the truth for an image of a size; the file's ending says what it is.
pub(super) fn read(path: &Path, size: [usize; 2]) -> anyhow::Result<Vec<f32>> {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let truth = match ending.as_str() {
        "pfm" => {
            std::fs::File::open(path).map_err(Into::into).and_then(|file| pfm(BufReader::new(file), size))
        }
        "png" => png(path, size),
        "npz" => npz(path, size),
        _ => return Err(usage(format!("truth is a .pfm, .png or .npz file, got {}", path.display()))),
    };
    truth.with_context(|| format!("cannot read {}", path.display()))
}

fn check_size(got: [u64; 2], expected: [usize; 2]) -> anyhow::Result<()> {
    anyhow::ensure!(
        got == expected.map(|side| side as u64),
        "truth is {}x{} pixels, the images have {}x{}",
        got[0],
        got[1],
        expected[0],
        expected[1]
    );
    Ok(())
}

/// Grey PFM: `Pf`, size, scale (negative: little endian), then rows from the bottom.
fn pfm(mut file: impl BufRead, size: [usize; 2]) -> anyhow::Result<Vec<f32>> {
    let mut words = Vec::new();
    while words.len() < 4 {
        let mut line = Vec::new();
        // A header has four short words: what goes on without a line's end is none.
        let read = (&mut file).take(256).read_until(b'\n', &mut line)?;
        anyhow::ensure!(read > 0 && line.ends_with(b"\n"), "header of the PFM is cut off");
        words.extend(String::from_utf8_lossy(&line).split_whitespace().map(str::to_owned));
    }
    anyhow::ensure!(words[0] == "Pf", "expected a grey PFM (Pf), got {:?}", words[0]);
    check_size([words[1].parse()?, words[2].parse()?], size)?;
    let scale: f32 = words[3].parse()?;
    let mut bytes = vec![0; size[0] * size[1] * 4];
    file.read_exact(&mut bytes).context("pixels of the PFM are cut off")?;
    let from = if scale < 0.0 { f32::from_le_bytes } else { f32::from_be_bytes };
    let values: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|bytes| from(*bytes)).collect();
    Ok(values.chunks_exact(size[0]).rev().flatten().copied().collect())
}

fn png(path: &Path, size: [usize; 2]) -> anyhow::Result<Vec<f32>> {
    let image = image::open(path)?;
    let image::DynamicImage::ImageLuma16(image) = image else {
        anyhow::bail!("expected a grey PNG of 16 bits, got {:?}", image.color());
    };
    check_size([u64::from(image.width()), u64::from(image.height())], size)?;
    Ok(image.into_raw().into_iter().map(|value| f32::from(value) / 256.0).collect())
}

/// The first array of the archive.
fn npz(path: &Path, size: [usize; 2]) -> anyhow::Result<Vec<f32>> {
    // Uncompressed, the array has at most 8 bytes a pixel and a header.
    let limit = size[0] * size[1] * 8 + (1 << 16);
    npy(&npz::first_entry(&std::fs::read(path)?, limit)?, size)
}

/// An array file of `NumPy`: a magic number, a header that is a Python dictionary, and the numbers.
fn npy(bytes: &[u8], size: [usize; 2]) -> anyhow::Result<Vec<f32>> {
    let cut_off = "header of the array is cut off";
    anyhow::ensure!(bytes.starts_with(b"\x93NUMPY"), "expected an array of NumPy");
    let (start, length) = match *bytes.get(6..12).context(cut_off)? {
        [1, _, a, b, ..] => (10, usize::from(u16::from_le_bytes([a, b]))),
        [_, _, a, b, c, d] => (12, u32::from_le_bytes([a, b, c, d]) as usize),
        _ => anyhow::bail!(cut_off),
    };
    let header = bytes.get(start..).and_then(|rest| rest.get(..length)).context(cut_off)?;
    let header = String::from_utf8_lossy(header);
    let value = |key: &str| {
        let rest = header.split_once(&format!("'{key}':")).map(|(_, rest)| rest.trim_start());
        rest.with_context(|| format!("header of the array has no {key}: {header}"))
    };
    anyhow::ensure!(
        value("fortran_order")?.starts_with("False"),
        "array is stored by columns, expected rows"
    );
    let shape = value("shape")?.split_once(')').context(cut_off)?.0;
    let shape: Vec<u64> = shape
        .trim_start_matches('(')
        .split(',')
        .filter(|side| !side.trim().is_empty())
        .map(|side| side.trim().parse().with_context(|| format!("shape of the array is ({shape})")))
        .collect::<Result<_, _>>()?;
    let &[height, width] = shape.as_slice() else {
        anyhow::bail!("array has {} dimensions, expected 2", shape.len());
    };
    check_size([width, height], size)?;
    let kind = value("descr")?.split('\'').nth(1).unwrap_or_default();
    let data = &bytes[start + length..];
    let values: Vec<f32> = match kind {
        "<f4" => data.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect(),
        "<f8" => data.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes) as f32).collect(),
        _ => anyhow::bail!("array holds {kind}, expected <f4 or <f8"),
    };
    anyhow::ensure!(
        values.len() == size[0] * size[1],
        "array has {} numbers, expected {}",
        values.len(),
        size[0] * size[1]
    );
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pfm_rows_are_stored_from_the_bottom_in_either_byte_order() {
        let values = [1.0_f32, 2.0, 3.0, f32::INFINITY, 5.0, 6.0];
        let little: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let big: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
        for (scale, bytes) in [("-1.0", little), ("1", big)] {
            let file = [format!("Pf\n3 2\n{scale}\n").into_bytes(), bytes].concat();
            let truth = pfm(file.as_slice(), [3, 2]).unwrap();
            assert_eq!(truth, [f32::INFINITY, 5.0, 6.0, 1.0, 2.0, 3.0]);
            assert!(pfm(&file[..file.len() - 1], [3, 2]).unwrap_err().to_string().contains("cut off"));
            assert!(pfm(file.as_slice(), [2, 3]).unwrap_err().to_string().contains("truth is 3x2 pixels"));
        }
        for file in ["", "Pf\n3 2", "PF\n3 2\n-1\n", "Pf\nx 2\n-1\n", "Pf\n3 2\n\n\n"] {
            assert!(pfm(file.as_bytes(), [3, 2]).is_err(), "{file:?}");
        }
    }

    #[test]
    fn arrays_are_read_as_their_header_says() {
        let file = |header: &str, data: &[u8]| {
            [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), data].concat()
        };
        let single: Vec<u8> = [1.5_f32, 2.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        let double: Vec<u8> = [1.5_f64, 2.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        for (kind, data) in [("<f4", &single), ("<f8", &double)] {
            let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': (1, 2), }}\n");
            let bytes = file(&header, data);
            assert_eq!(npy(&bytes, [2, 1]).unwrap(), [1.5, 2.0]);
            for end in 0..bytes.len() {
                assert!(npy(&bytes[..end], [2, 1]).is_err());
            }
        }
        let check = |header: &str, expected: &str| {
            let error = npy(&file(header, &single), [2, 1]).unwrap_err().to_string();
            assert!(error.contains(expected), "got \"{error}\", expected \"{expected}\"");
        };
        check("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 1)}", "truth is 1x2 pixels");
        check("{'descr': '<f4', 'fortran_order': False, 'shape': (2,)}", "1 dimensions, expected 2");
        check("{'descr': '<f4', 'fortran_order': True, 'shape': (1, 2)}", "by columns");
        check("{'descr': '<i4', 'fortran_order': False, 'shape': (1, 2)}", "array holds <i4");
        check("{'descr': '<f4', 'shape': (1, 2)}", "no fortran_order");
    }
}
