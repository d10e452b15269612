//! Reads STL files: binary, or text of one solid or several, in capitals or small letters.

use nalgebra::Point3;

use super::MOST_TRIANGLES;
use crate::{InputError, mesh::TriangleMesh};

/// Bytes in front of the triangles of a binary file, and of each of them.
const HEAD: usize = 84;
const EACH: usize = 50;

/// Content that an STL file should have.
const EXPECTED: &str = "an STL mesh, binary or text";

/// Vertices and triangles of all solids of a file.
pub(super) fn read(file: &str, bytes: &[u8]) -> Result<TriangleMesh, InputError> {
    let count = bytes.get(80..HEAD).and_then(|it| it.try_into().ok()).map_or(0, u32::from_le_bytes) as usize;
    // Some binary files begin like text files; their length tells.
    let end = HEAD + EACH * count;
    if bytes.len() != end && is_text(bytes) {
        return text(file, bytes);
    }
    let fault = |found: String| Err(InputError::new(file, "content", found, EXPECTED));
    match bytes.get(HEAD..end) {
        None => return fault(format!("{} bytes for {count} triangles", bytes.len())),
        Some(_) if count > MOST_TRIANGLES => return fault(format!("more than {MOST_TRIANGLES} triangles")),
        // Writers fill up files; more than that is another solid, or the count is wrong.
        Some(_)
            if bytes[end..].len() >= EACH && bytes[end..].iter().any(|it| *it != 0 && !it.is_ascii_whitespace()) =>
        {
            return fault(format!("{} bytes behind the {count} triangles of the header", bytes.len() - end));
        }
        Some(_) if count == 0 => return fault("no triangles".into()),
        Some(_) => {}
    }
    let number = |bytes: &[u8; 4]| f64::from(f32::from_le_bytes(*bytes));
    // Of the 50 bytes of a triangle the first 12 are its normal, which follows from its corners.
    let corners = bytes[HEAD..end].chunks_exact(EACH).flat_map(|it| it[12..48].as_chunks::<12>().0);
    let corner = |it: &[u8; 12]| Point3::from(std::array::from_fn(|k| number(&it.as_chunks().0[k])));
    Ok(of_corners(corners.map(corner).collect()))
}

/// A surface whose triangles have no vertex in common.
fn of_corners(vertices: Vec<Point3<f64>>) -> TriangleMesh {
    let triangles = (0..vertices.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    TriangleMesh { vertices, triangles }
}

fn is_text(bytes: &[u8]) -> bool {
    let begin = bytes.trim_ascii_start();
    let begin = begin.strip_prefix(b"\xef\xbb\xbf").unwrap_or(begin).trim_ascii_start();
    let begins = begin.get(..5).is_some_and(|it| it.eq_ignore_ascii_case(b"solid"));
    begins && bytes.iter().take(1000).all(|it| *it >= 0x80 || !it.is_ascii_control() || it.is_ascii_whitespace())
}

fn text(file: &str, bytes: &[u8]) -> Result<TriangleMesh, InputError> {
    let text = String::from_utf8_lossy(bytes);
    let (mut corners, mut solids, mut is_open) = (Vec::new(), 0, false);
    // Words of a facet that are still to come.
    let mut words: Vec<&str> = Vec::new();
    for (i, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let fault = |found: &str, expected: &str| {
            let found = format!("`{}`", found.chars().take(60).collect::<String>());
            InputError::new(file, format!("line {}", i + 1), found, expected)
        };
        for word in line.split_whitespace() {
            let is = |other: &str| word.eq_ignore_ascii_case(other);
            if words.is_empty() && is(if is_open { "endsolid" } else { "solid" }) {
                (solids, is_open) = (solids + usize::from(!is_open), !is_open);
                // Names are the rest of the line.
                break;
            }
            if !is_open {
                return Err(fault(line.trim(), "`solid` or the end of the file"));
            }
            let is_right = match WORDS[words.len()] {
                "#" => word.parse::<f32>().is_ok(),
                right => is(right),
            };
            if !is_right {
                return Err(fault(line.trim(), FACET));
            }
            words.push(word);
            if words.len() == WORDS.len() {
                let number = |at: usize| words[at].parse::<f32>().map_or(f64::NAN, f64::from);
                corners.extend([8, 12, 16].map(|at| Point3::new(number(at), number(at + 1), number(at + 2))));
                words.clear();
            }
        }
        if corners.len() > 3 * MOST_TRIANGLES {
            return Err(fault("one more facet", &format!("at most {MOST_TRIANGLES}")));
        }
    }
    if is_open || solids == 0 {
        return Err(InputError::new(file, "content", "a solid without its end", "`endsolid`: the whole file"));
    }
    Ok(of_corners(corners))
}

/// The words of a facet; `#` is a number.
const WORDS: [&str; 21] = [
    "facet", "normal", "#", "#", "#", "outer", "loop", "vertex", "#", "#", "#", "vertex", "#", "#", "#", "vertex", "#",
    "#", "#", "endloop", "endfacet",
];
const FACET: &str = "facet normal, outer loop, three vertices with numbers, endloop, endfacet";

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: &str =
        "facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1e0 0 0\n  vertex 0 1 0\n endloop\nendfacet\n";

    fn count(text: &str) -> Result<usize, String> {
        read("a.stl", text.as_bytes()).map(|it| it.triangles.len()).map_err(|it| it.to_string())
    }

    #[test]
    fn texts_are_read_however_they_are_written() {
        let one = format!("solid a b\n{TRIANGLE}endsolid a b\n");
        assert_eq!(count(&one), Ok(1));
        for text in [
            format!("\n \n  {one}"),
            one.to_uppercase(),
            one.replace('\n', "\r\n"),
            format!("\u{feff}{one}"),
            one.replace("solid a b\n", "solid\t\n"),
            one.replace("\n  ", " "),
        ] {
            assert_eq!(count(&text), Ok(1), "{text}");
        }
        assert_eq!(count(&format!("{one}\n{one}")), Ok(2));
        for (text, expected) in [
            (format!("{one}and more"), "line 10: found `and more`"),
            (one.replace("endsolid a b", ""), "without its end"),
            (one.replace("vertex 0 1 0\n", "vertex 0 1 0\n vertex 0 2 0\n"), "three vertices"),
            (one.replace("1e0", "one"), "line 5: found `vertex one 0 0`"),
            (one.replace("outer", "outre"), "line 3: found `outre loop`"),
        ] {
            assert!(count(&text).unwrap_err().contains(expected), "{text}: {:?}", count(&text));
        }
    }

    #[test]
    fn binary_files_hold_what_their_header_says() {
        let mut bytes = b"solid of some program".to_vec();
        bytes.resize(80, b' ');
        bytes.extend(2u32.to_le_bytes());
        bytes.extend([1; 100]);
        let count = |bytes: &[u8]| read("a.stl", bytes).map(|it| it.triangles.len()).map_err(|it| it.to_string());
        assert_eq!(count(&bytes), Ok(2));
        assert_eq!(count(&[&bytes[..], &[0; 10]].concat()), Ok(2));
        assert!(count(&[&bytes[..], &[7; 50]].concat()).unwrap_err().contains("50 bytes behind the 2 triangles"));
        assert!(count(&bytes[..150]).is_err());
    }
}
