//! PNG images with one channel of 16 bits, as depth images are kept.

use std::io::Cursor;

use catch_body::InputError;
use png::{BitDepth, ColorType, Decoder};

/// The values of an image of `width` times `height`, row by row; `file` names it in errors.
///
/// # Errors
/// Any other image: another size, colours, other bits per value, interlaced, broken.
pub fn gray16_values(file: &str, bytes: &[u8], [width, height]: [u32; 2]) -> Result<Vec<u16>, InputError> {
    let fault = |field: &str, found: String, expected: &str| InputError::new(file, field, found, expected);
    let broken = |it: png::DecodingError| fault("image", it.to_string(), "a whole PNG file: save it anew");
    let mut reader = Decoder::new(Cursor::new(bytes)).read_info().map_err(broken)?;
    let info = reader.info();
    if [info.width, info.height] != [width, height] {
        let found = format!("{} × {} pixels", info.width, info.height);
        return Err(fault("size", found, &format!("the camera's {width} × {height}")));
    }
    let kind = (info.color_type, info.bit_depth, info.interlaced);
    if kind != (ColorType::Grayscale, BitDepth::Sixteen, false) {
        let interlaced = if info.interlaced { ", interlaced" } else { "" };
        let found = format!("{:?}, {} bits{interlaced}", info.color_type, info.bit_depth as u8);
        return Err(fault("kind", found, "Grayscale, 16 bits, not interlaced: one depth per pixel"));
    }
    let mut values = vec![0; 2 * width as usize * height as usize];
    reader.next_frame(&mut values).map_err(broken)?;
    Ok(values.chunks_exact(2).map(|it| u16::from_be_bytes([it[0], it[1]])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use png::Encoder;

    /// A gradient of 5 × 5 pixels, each row with another filter, in two chunks. Pillow 12 reads these values.
    const ALL_FILTERS: &[u8] = include_bytes!("png/filters.png");

    fn encoded([width, height]: [u32; 2], color: ColorType, depth: BitDepth, bytes: &[u8]) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = Encoder::new(&mut file, width, height);
        encoder.set_color(color);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(bytes).unwrap();
        file
    }

    #[test]
    fn rows_of_all_filters_are_read() {
        let gradient: Vec<u16> = (0..25).map(|i| i * 2600 + [0, 7, 1, 9, 3][usize::from(i) % 5]).collect();
        assert_eq!(gray16_values("a.png", ALL_FILTERS, [5, 5]).unwrap(), gradient);
    }

    #[test]
    fn broken_images_are_named() {
        let gray = (ColorType::Grayscale, BitDepth::Sixteen);
        let whole = encoded([3, 2], gray.0, gray.1, &[0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 6, 7]);
        assert_eq!(gray16_values("a.png", &whole, [3, 2]).unwrap(), [1, 2, 3, 4, 5, 0x0607]);
        let mut flipped = whole.clone();
        flipped[45] ^= 1;
        for (bytes, expected) in [
            (b"BM".to_vec(), "a.png: image: found "),
            (whole[..45].to_vec(), "a.png: image: found "),
            (flipped, "a.png: image: found "),
            (encoded([4, 2], gray.0, gray.1, &[0; 16]), "size: found 4 × 2 pixels, expected the camera's 3 × 2"),
            (encoded([3, 2], ColorType::Grayscale, BitDepth::Eight, &[0; 6]), "kind: found Grayscale, 8 bits"),
            (encoded([3, 2], ColorType::Rgb, BitDepth::Sixteen, &[0; 36]), "kind: found Rgb, 16 bits"),
        ] {
            let fault = gray16_values("a.png", &bytes, [3, 2]).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
