//! Reads ground truth disparities from files: PFM, 16-bit PNG in 1/256 pixel, or `NumPy`'s NPZ.
//!
//! Disparities are in pixels, by rows from the top; values that are not finite or not positive are unknown. Libraries
//! read the archive and the PNG. The headers of PFM and of `NumPy`'s arrays are parsed here, because the crate `image`
//! has no PFM, and the crates for `NumPy` depend on a parser generator and big integers for a header of three entries.

use crate::EvalError;
use crate::report::counted;
use flate2::bufread::DeflateDecoder;
use rawzip::{CompressionMethod, ZipArchive};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Why a file is not valid ground truth for the images.
#[derive(Debug, thiserror::Error)]
enum TruthError {
    #[error("{0}")]
    Wrong(String),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error(transparent)]
    Image(#[from] image::ImageError),
    #[error("not a zip archive with an array, or one that is cut off: {0}")]
    Zip(#[from] rawzip::Error),
}

fn wrong(text: impl Into<String>) -> TruthError {
    TruthError::Wrong(text.into())
}

/// Reads the ground truth of an image with this size; the file's extension gives the format.
pub(crate) fn read(path: &Path, size: [usize; 2]) -> Result<Vec<f32>, EvalError> {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let file = || File::open(path).map_err(TruthError::from);
    let truth = match ending.as_str() {
        "pfm" => file().and_then(|file| pfm(BufReader::new(file), size)),
        "png" => png(path, size),
        "npz" => std::fs::read(path).map_err(TruthError::from).and_then(|bytes| npz(&bytes, size)),
        _ => {
            let path = path.display();
            return Err(EvalError::refused(format!("truth is a .pfm, .png or .npz file, got {path}")));
        }
    };
    truth.map_err(|error| EvalError::read(path, error))
}

fn check_size(got: [u64; 2], expected: [usize; 2]) -> Result<(), TruthError> {
    if got == expected.map(|side| side as u64) {
        return Ok(());
    }
    let ([a, b], [c, d]) = (got, expected);
    Err(wrong(format!("truth is {a}x{b} pixels, the images have {c}x{d}")))
}

/// Grey PFM: `Pf`, size, scale (negative: little endian), then rows from the bottom.
fn pfm(mut file: impl BufRead, size: [usize; 2]) -> Result<Vec<f32>, TruthError> {
    let mut words = Vec::new();
    while words.len() < 4 {
        let mut line = Vec::new();
        // A header has four short words: longer text without a line end is not a header.
        let read = (&mut file).take(256).read_until(b'\n', &mut line)?;
        if read == 0 || !line.ends_with(b"\n") {
            return Err(wrong("header of the PFM is cut off"));
        }
        words.extend(String::from_utf8_lossy(&line).split_whitespace().map(str::to_owned));
    }
    if words[0] != "Pf" {
        return Err(wrong(format!("expected a grey PFM (Pf), got {:?}", words[0])));
    }
    let side =
        |what: &str, word: &str| word.parse().map_err(|_| not_in_pfm(what, word, "a number of pixels"));
    check_size([side("width", &words[1])?, side("height", &words[2])?], size)?;
    let scale = words[3].parse::<f32>().ok().filter(|scale| scale.is_finite() && *scale != 0.0);
    let scale = scale.ok_or_else(|| not_in_pfm("scale", &words[3], "a finite number other than 0"))?;
    let mut bytes = vec![0; size[0] * size[1] * 4];
    file.read_exact(&mut bytes).map_err(|error| wrong(format!("pixels of the PFM are cut off: {error}")))?;
    let from = if scale < 0.0 { f32::from_le_bytes } else { f32::from_be_bytes };
    let values: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|bytes| from(*bytes)).collect();
    Ok(values.chunks_exact(size[0]).rev().flatten().copied().collect())
}

/// The error for a word of a PFM's header that cannot be read.
fn not_in_pfm(what: &str, word: &str, expected: &str) -> TruthError {
    wrong(format!("{what} of the PFM is {word:?}, expected {expected}"))
}

fn png(path: &Path, size: [usize; 2]) -> Result<Vec<f32>, TruthError> {
    let image = image::open(path)?;
    let image::DynamicImage::ImageLuma16(image) = image else {
        return Err(wrong(format!("expected a grey PNG of 16 bits, got {:?}", image.color())));
    };
    check_size([u64::from(image.width()), u64::from(image.height())], size)?;
    Ok(image.into_raw().into_iter().map(|value| f32::from(value) / 256.0).collect())
}

/// The first array of the archive.
fn npz(bytes: &[u8], size: [usize; 2]) -> Result<Vec<f32>, TruthError> {
    // Uncompressed, the array has a header and at most 8 bytes per pixel.
    let limit = size[0] * size[1] * 8 + (1 << 16);
    let archive = ZipArchive::from_slice(bytes)?;
    let mut entries = archive.entries();
    let header = entries.next_entry()?.ok_or_else(|| wrong("the archive is empty"))?;
    if header.uncompressed_size_hint() > limit as u64 {
        return Err(wrong(format!("array has more than {limit} bytes: it is not of the images' size")));
    }
    let entry = archive.get_entry(header.wayfinder())?;
    let mut array = Vec::new();
    // The verifying reader refuses data that are longer than the header says or have another checksum.
    match header.compression_method() {
        CompressionMethod::STORE => entry.verifying_reader(entry.data()).read_to_end(&mut array)?,
        CompressionMethod::DEFLATE => {
            entry.verifying_reader(DeflateDecoder::new(entry.data())).read_to_end(&mut array)?
        }
        other => return Err(wrong(format!("array is packed by {other:?}, expected it stored or deflated"))),
    };
    let name = String::from_utf8_lossy(header.file_path().as_bytes());
    npy(&array, size).map_err(|error| wrong(format!("{name}, the first array of the archive: {error}")))
}

/// A `NumPy` array file: a magic number, a header that is a Python dictionary, and the numbers.
fn npy(bytes: &[u8], size: [usize; 2]) -> Result<Vec<f32>, TruthError> {
    let cut_off = || wrong("header of the array is cut off");
    if !bytes.starts_with(b"\x93NUMPY") {
        return Err(wrong("expected an array of NumPy"));
    }
    let (start, length) = match *bytes.get(6..12).ok_or_else(cut_off)? {
        [1, _, a, b, ..] => (10, usize::from(u16::from_le_bytes([a, b]))),
        [_, _, a, b, c, d] => (12, u32::from_le_bytes([a, b, c, d]) as usize),
        _ => return Err(cut_off()),
    };
    let header = bytes.get(start..).and_then(|rest| rest.get(..length)).ok_or_else(cut_off)?;
    let header = String::from_utf8_lossy(header);
    let value = |key: &str| {
        let rest = header.split_once(&format!("'{key}':")).map(|(_, rest)| rest.trim_start());
        rest.ok_or_else(|| wrong(format!("header of the array has no {key}: {header}")))
    };
    if !value("fortran_order")?.starts_with("False") {
        return Err(wrong("array is stored by columns, expected rows"));
    }
    let shape = value("shape")?.split_once(')').ok_or_else(cut_off)?.0;
    let shape: Vec<u64> = shape
        .trim_start_matches('(')
        .split(',')
        .filter(|side| !side.trim().is_empty())
        .map(|side| side.trim().parse().map_err(|_| wrong(format!("shape of the array is ({shape})"))))
        .collect::<Result<_, _>>()?;
    let &[height, width] = shape.as_slice() else {
        let dimensions = counted(shape.len() as u64, "dimension");
        return Err(wrong(format!("array has {dimensions}, expected 2")));
    };
    check_size([width, height], size)?;
    let kind = value("descr")?.split('\'').nth(1).unwrap_or_default();
    let data = &bytes[start + length..];
    let values: Vec<f32> = match kind {
        "<f4" => data.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect(),
        "<f8" => data.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes) as f32).collect(),
        _ => return Err(wrong(format!("array holds {kind}, expected <f4 or <f8"))),
    };
    if values.len() != size[0] * size[1] {
        let expected = size[0] * size[1];
        return Err(wrong(format!("array has {} numbers, expected {expected}", values.len())));
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::DeflateEncoder;
    use rawzip::ZipArchiveWriter;
    use std::io::Write;

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
        let refused = |file: &str| pfm(file.as_bytes(), [3, 2]).unwrap_err().to_string();
        for scale in ["abc", "0", "-0.0", "nan", "inf"] {
            let expected = format!("scale of the PFM is {scale:?}, expected a finite number other than 0");
            assert_eq!(refused(&format!("Pf\n3 2\n{scale}\n")), expected);
        }
        assert_eq!(refused("Pf\nx 2\n1\n"), "width of the PFM is \"x\", expected a number of pixels");
    }

    /// An array file with this header.
    fn array(header: &str, data: &[u8]) -> Vec<u8> {
        [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), data].concat()
    }

    fn bytes_of(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    #[test]
    fn arrays_are_read_as_their_header_says() {
        let single = bytes_of(&[1.5, 2.0]);
        let double: Vec<u8> = [1.5_f64, 2.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        for (kind, data) in [("<f4", &single), ("<f8", &double)] {
            let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': (1, 2), }}\n");
            let bytes = array(&header, data);
            assert_eq!(npy(&bytes, [2, 1]).unwrap(), [1.5, 2.0]);
            for end in 0..bytes.len() {
                assert!(npy(&bytes[..end], [2, 1]).is_err());
            }
        }
        let check = |header: &str, expected: &str| {
            let error = npy(&array(header, &single), [2, 1]).unwrap_err().to_string();
            assert!(error.contains(expected), "got \"{error}\", expected \"{expected}\"");
        };
        check("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 1)}", "truth is 1x2 pixels");
        check("{'descr': '<f4', 'fortran_order': False, 'shape': (2,)}", "1 dimension, expected 2");
        check("{'descr': '<f4', 'fortran_order': True, 'shape': (1, 2)}", "by columns");
        check("{'descr': '<i4', 'fortran_order': False, 'shape': (1, 2)}", "array holds <i4");
        check("{'descr': '<f4', 'shape': (1, 2)}", "no fortran_order");
    }

    fn archive(method: CompressionMethod, entry: &[u8]) -> Vec<u8> {
        let mut zip = Vec::new();
        let mut archive = ZipArchiveWriter::new(&mut zip);
        let (mut file, config) = archive.new_file("arr_0.npy").compression_method(method).start().unwrap();
        let descriptor = if method == CompressionMethod::STORE {
            let mut writer = config.wrap(&mut file);
            writer.write_all(entry).unwrap();
            writer.finish().unwrap().1
        } else {
            let mut writer = config.wrap(DeflateEncoder::new(&mut file, Compression::default()));
            writer.write_all(entry).unwrap();
            let (encoder, descriptor) = writer.finish().unwrap();
            encoder.finish().unwrap();
            descriptor
        };
        file.finish(descriptor).unwrap();
        archive.finish().unwrap();
        zip
    }

    #[test]
    fn stored_and_deflated_archives_are_read_and_damaged_or_huge_ones_are_refused() {
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2), }\n";
        let entry = array(header, &bytes_of(&[1.5, 2.0]));
        for method in [CompressionMethod::STORE, CompressionMethod::DEFLATE] {
            let bytes = archive(method, &entry);
            let read = |bytes: &[u8]| npz(bytes, [2, 1]);
            assert_eq!(read(&bytes).unwrap(), [1.5, 2.0]);
            for end in 0..bytes.len() {
                assert!(read(&bytes[..end]).is_err(), "cut off at {end}");
            }
            for at in 0..bytes.len() {
                let mut damaged = bytes.clone();
                damaged[at] ^= 0xff;
                // Any result is accepted, but no panic, and no more numbers than requested.
                assert!(read(&damaged).map_or(2, |values| values.len()) == 2);
            }
        }
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }\n";
        let list = array(header, &bytes_of(&[1.5, 2.0]));
        let error = npz(&archive(CompressionMethod::STORE, &list), [2, 1]).unwrap_err().to_string();
        let expected = "arr_0.npy, the first array of the archive: array has 1 dimension, expected 2";
        assert_eq!(error, expected);
        let huge = archive(CompressionMethod::DEFLATE, &vec![0; 1 << 20]);
        let error = npz(&huge, [2, 1]).unwrap_err().to_string();
        assert!(error.contains("more than 65552 bytes"), "{error}");
    }
}
