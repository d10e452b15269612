//! Portable Network Graphics (PNG, third edition) with one channel of 16 bits, as depth images are kept.

use std::io::{Read, Write};

use catch_body::InputError;
use flate2::{Compression, Crc, read::ZlibDecoder, write::ZlibEncoder};

const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
/// 16 bits, gray, deflate, the usual filters, not interlaced.
const KIND: [u8; 5] = [16, 0, 0, 0, 0];
/// Bytes of a value.
const VALUE: usize = 2;

/// An image of `width` times `height` values, row by row.
pub fn gray16(width: u32, height: u32, values: &[u16]) -> Vec<u8> {
    let mut rows = Vec::with_capacity(VALUE * values.len() + height as usize);
    for row in values.chunks(width.max(1) as usize) {
        // No filter.
        rows.push(0);
        rows.extend(row.iter().flat_map(|it| it.to_be_bytes()));
    }
    let mut packer = ZlibEncoder::new(Vec::new(), Compression::fast());
    // Writing to memory cannot fail.
    let packed = packer.write_all(&rows).and_then(|()| packer.finish()).unwrap_or_default();
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &KIND].concat();
    let mut file = SIGNATURE.to_vec();
    for (name, content) in [(b"IHDR", &header), (b"IDAT", &packed), (b"IEND", &Vec::new())] {
        let mut check = Crc::new();
        check.update(name);
        check.update(content);
        file.extend((content.len() as u32).to_be_bytes());
        file.extend(name);
        file.extend(content);
        file.extend(check.sum().to_be_bytes());
    }
    file
}

/// The values of an image of `width` times `height`, row by row; `file` names it in errors.
///
/// # Errors
/// What is no such image: another size, colours, other bits per value, interlaced, broken.
pub fn gray16_values(file: &str, bytes: &[u8], [width, height]: [u32; 2]) -> Result<Vec<u16>, InputError> {
    let fault = |field: &str, found: String, expected: &str| InputError::new(file, field, found, expected);
    let broken = |field: &str, found: &str| fault(field, found.to_owned(), "a whole PNG file: save it anew");
    let mut rest = bytes
        .strip_prefix(SIGNATURE)
        .ok_or_else(|| fault("signature", "no PNG file".to_owned(), "a PNG file with 16 bits of gray"))?;
    let (mut header, mut packed) = (None, Vec::new());
    while let Some((head, after)) = rest.split_first_chunk::<8>() {
        let [length, name] = [&head[..4], &head[4..]].map(|it| <[u8; 4]>::try_from(it).unwrap_or_default());
        let field = String::from_utf8_lossy(&name).into_owned();
        let length = u32::from_be_bytes(length) as usize;
        let content = after.get(..length).ok_or_else(|| broken(&field, "the file ends within it"))?;
        let sum = after.get(length..length + 4).ok_or_else(|| broken(&field, "the file ends within it"))?;
        let mut check = Crc::new();
        check.update(&name);
        check.update(content);
        if check.sum().to_be_bytes() != sum {
            return Err(broken(&field, "another checksum"));
        }
        match &name {
            b"IHDR" => header = <[u8; 13]>::try_from(content).ok(),
            b"IDAT" => packed.extend_from_slice(content),
            b"IEND" => break,
            _ => {}
        }
        rest = &after[length + 4..];
    }
    let header = header.ok_or_else(|| broken("IHDR", "none"))?;
    let [columns, rows] = [0, 4].map(|at| u32::from_be_bytes([0, 1, 2, 3].map(|i| header[at + i])));
    if [columns, rows] != [width, height] {
        return Err(fault("size", format!("{columns} × {rows} pixels"), &format!("the camera's {width} × {height}")));
    }
    if header[8..] != KIND {
        let [bits, colour, .., interlaced] = [header[8], header[9], header[10], header[11], header[12]];
        let found = format!("{bits} bits, colour type {colour}, interlacing {interlaced}");
        return Err(fault("IHDR", found, "16 bits, colour type 0 (gray), interlacing 0: one depth per pixel"));
    }
    let stride = VALUE * width as usize;
    let size = (stride + 1) * height as usize;
    let mut unpacked = Vec::with_capacity(size);
    // Not one byte more than the image has.
    let read = ZlibDecoder::new(&packed[..]).take(size as u64).read_to_end(&mut unpacked);
    if read.is_err() || unpacked.len() != size {
        return Err(broken("IDAT", &format!("{} of {size} bytes", unpacked.len())));
    }
    let (mut values, mut above) = (Vec::with_capacity(size / VALUE), vec![0; stride]);
    for row in unpacked.chunks_exact_mut(stride + 1) {
        let (filter, row) = (row[0], &mut row[1..]);
        for i in 0..stride {
            let [left, corner] = [&row[..], &above].map(|it| i.checked_sub(VALUE).map_or(0, |i| it[i]));
            let expected = match filter {
                0 => 0,
                1 => left,
                2 => above[i],
                3 => left.midpoint(above[i]),
                4 => paeth(left, above[i], corner),
                other => return Err(broken("IDAT", &format!("filter {other}"))),
            };
            row[i] = row[i].wrapping_add(expected);
        }
        values.extend(row.chunks_exact(VALUE).map(|it| u16::from_be_bytes([it[0], it[1]])));
        above.copy_from_slice(row);
    }
    Ok(values)
}

/// Of three neighbours the one that is nearest to left + above − corner.
fn paeth(left: u8, above: u8, corner: u8) -> u8 {
    let estimate = i16::from(left) + i16::from(above) - i16::from(corner);
    let off = |it: &u8| (estimate - i16::from(*it)).abs();
    [left, above, corner].into_iter().min_by_key(off).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gradient of 5 × 5 pixels, each row with another filter, in two chunks. Pillow 12 reads these values.
    const ALL_FILTERS: &[u8] = include_bytes!("png/filters.png");

    #[test]
    fn an_image_has_header_rows_and_end() {
        let file = gray16(2, 1, &[1, 0x0203]);
        assert_eq!(&file[12..16], b"IHDR");
        assert_eq!(file[16..29], [0, 0, 0, 2, 0, 0, 0, 1, 16, 0, 0, 0, 0]);
        // The checksum of an empty last chunk is known.
        assert!(file.ends_with(b"\0\0\0\0IEND\xae\x42\x60\x82"));
        assert_eq!(gray16_values("a.png", &file, [2, 1]).unwrap(), [1, 0x0203]);
    }

    #[test]
    fn rows_of_all_filters_are_read() {
        let gradient: Vec<u16> = (0..25).map(|i| i * 2600 + [0, 7, 1, 9, 3][usize::from(i) % 5]).collect();
        assert_eq!(gray16_values("a.png", ALL_FILTERS, [5, 5]).unwrap(), gradient);
    }

    #[test]
    fn broken_images_are_named() {
        let whole = gray16(3, 2, &[1, 2, 3, 4, 5, 6]);
        let with = |at: usize, byte: u8| {
            let mut bytes = whole.clone();
            bytes[at] = byte;
            // The checksum of the header fits what it says.
            let mut check = Crc::new();
            check.update(&bytes[12..29]);
            bytes[29..33].copy_from_slice(&check.sum().to_be_bytes());
            bytes
        };
        for (bytes, expected) in [
            (b"BM".to_vec(), "signature: found no PNG file"),
            (whole[..45].to_vec(), "IDAT: found the file ends within it"),
            (with(19, 4), "size: found 4 × 2 pixels, expected the camera's 3 × 2"),
            (with(24, 8), "IHDR: found 8 bits, colour type 0"),
            (with(25, 2), "colour type 2"),
            (with(28, 1), "interlacing 1"),
            (with(45, 99), "IDAT: found another checksum"),
        ] {
            let fault = gray16_values("a.png", &bytes, [3, 2]).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
