//! The first file of a zip archive, which is all that an NPZ file with one array is.

use anyhow::Context as _;
use flate2::read::DeflateDecoder;
use std::io::Read as _;

/// Signature and least length of the record that ends an archive.
const END: (&[u8], usize) = (b"PK\x05\x06", 22);

/// The bytes of the first entry, refused where they are more than `limit`.
pub(super) fn first_entry(zip: &[u8], limit: usize) -> anyhow::Result<Vec<u8>> {
    let broken = "not a zip archive, or one that is cut off";
    // The record stands at the end, before a comment of at most 65535 bytes.
    let last = zip.len().checked_sub(END.1).context(broken)?;
    let end = (last.saturating_sub(0xffff)..=last)
        .rev()
        .find(|&at| zip[at..].starts_with(END.0))
        .context(broken)?;
    let entry = from(zip, number(zip, end + 16, 4).context(broken)?).context(broken)?;
    anyhow::ensure!(entry.starts_with(b"PK\x01\x02"), broken);
    let field = |at, bytes| number(entry, at, bytes).context(broken);
    let (method, packed, at) = (field(10, 2)?, field(20, 4)?, field(42, 4)?);
    // The local header repeats the name, with extra fields of its own: only their lengths count.
    let local = from(zip, at).context(broken)?;
    anyhow::ensure!(local.starts_with(b"PK\x03\x04"), broken);
    let skip = 30 + number(local, 26, 2).context(broken)? + number(local, 28, 2).context(broken)?;
    let data = from(local, skip).and_then(|rest| rest.get(..packed)).context(broken)?;
    let mut bytes = Vec::new();
    match method {
        0 => data.take(limit as u64 + 1).read_to_end(&mut bytes)?,
        8 => DeflateDecoder::new(data).take(limit as u64 + 1).read_to_end(&mut bytes).context(broken)?,
        _ => anyhow::bail!("entry is packed by method {method}, expected 0 (stored) or 8 (deflated)"),
    };
    anyhow::ensure!(bytes.len() <= limit, "array has more than {limit} bytes: it is not of the images' size");
    Ok(bytes)
}

fn from(bytes: &[u8], at: usize) -> Option<&[u8]> {
    bytes.get(at..)
}

/// A little-endian number of two or four bytes.
fn number(bytes: &[u8], at: usize, count: usize) -> Option<usize> {
    let bytes = bytes.get(at..)?.get(..count)?;
    Some(bytes.iter().rev().fold(0, |number, &byte| number << 8 | usize::from(byte)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::DeflateEncoder;
    use std::io::Write as _;

    /// An archive with one entry "a", whose local header has an extra field.
    fn archive(method: u16, data: &[u8]) -> Vec<u8> {
        let mut zip = b"before".to_vec();
        let at = zip.len() as u32;
        let size = (data.len() as u32).to_le_bytes();
        let method = method.to_le_bytes();
        zip.extend(
            [b"PK\x03\x04\0\0\0\0", &method[..], &[0; 8], &[0xff; 8], &[1, 0, 3, 0], b"aXYZ", data].concat(),
        );
        let directory = zip.len() as u32;
        let numbers = [&size[..], &size[..], &[1, 0], &[0; 12], &at.to_le_bytes()].concat();
        zip.extend([b"PK\x01\x02\0\0\0\0\0\0", &method[..], &[0; 8], &numbers, b"a"].concat());
        zip.extend([&b"PK\x05\x06"[..], &[0; 12], &directory.to_le_bytes(), &[2, 0], b"hi"].concat());
        zip
    }

    #[test]
    fn stored_and_deflated_entries_are_read_up_to_the_limit() {
        let text = b"numbers, numbers, numbers".repeat(20);
        let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(&text).unwrap();
        for (method, data) in [(0, text.clone()), (8, encoder.finish().unwrap())] {
            let zip = archive(method, &data);
            assert_eq!(first_entry(&zip, text.len()).unwrap(), text);
            assert!(
                first_entry(&zip, text.len() - 1).unwrap_err().to_string().contains("more than 499 bytes")
            );
            for end in 0..zip.len() - 2 {
                assert!(first_entry(&zip[..end], 1 << 20).is_err(), "cut off at {end}");
            }
            for at in 0..zip.len() {
                let mut damaged = zip.clone();
                damaged[at] ^= 0xff;
                // Whatever comes out, it is no panic and no more than was asked for.
                assert!(first_entry(&damaged, 1000).map_or(0, |bytes| bytes.len()) <= 1000);
            }
        }
        let other = first_entry(&archive(14, &text), 1000).unwrap_err();
        assert!(other.to_string().contains("packed by method 14"));
    }
}
