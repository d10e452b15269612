//! Portable Network Graphics (PNG, third edition) with one channel of 16 bits.

use std::io::Write;

use flate2::{Compression, Crc, write::ZlibEncoder};

/// An image of `width` times `height` values, row by row.
pub fn gray16(width: u32, height: u32, values: &[u16]) -> Vec<u8> {
    let mut rows = Vec::with_capacity(2 * values.len() + height as usize);
    for row in values.chunks(width.max(1) as usize) {
        // No filter.
        rows.push(0);
        rows.extend(row.iter().flat_map(|it| it.to_be_bytes()));
    }
    let mut packer = ZlibEncoder::new(Vec::new(), Compression::fast());
    // Writing to memory cannot fail.
    let packed = packer.write_all(&rows).and_then(|()| packer.finish()).unwrap_or_default();
    // 16 bits, gray, deflate, no other filters, not interlaced.
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[16, 0, 0, 0, 0]].concat();
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
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

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::read::ZlibDecoder;
    use std::io::Read;

    #[test]
    fn an_image_has_header_rows_and_end() {
        let file = gray16(2, 1, &[1, 0x0203]);
        assert_eq!(&file[12..16], b"IHDR");
        assert_eq!(file[16..29], [0, 0, 0, 2, 0, 0, 0, 1, 16, 0, 0, 0, 0]);
        // The checksum of an empty last chunk is known.
        assert!(file.ends_with(b"\0\0\0\0IEND\xae\x42\x60\x82"));
        let length = u32::from_be_bytes(file[33..37].try_into().unwrap()) as usize;
        let mut rows = Vec::new();
        ZlibDecoder::new(&file[41..41 + length]).read_to_end(&mut rows).unwrap();
        assert_eq!(rows, [0, 0, 1, 2, 3]);
    }
}
