//! Reads the polygons of Wavefront OBJ files.

use std::collections::HashMap;

use nalgebra::Point3;

use super::MOST_TRIANGLES;
use crate::{InputError, mesh::TriangleMesh};

/// Keywords of colours, textures, lines, points and curves: none of them is a surface.
const HARMLESS: &str = "vt vn vp s usemtl usemap mtllib maplib mg l p cstype deg bmat step curv curv2 \
    parm trim hole scrv sp end con bevel c_interp d_interp lod shadow_obj trace_obj ctech stech bzp bsp cdc \
    cdp res";

/// Vertices and triangles of each object or group that has a face; polygons are cut into fans.
pub(super) fn read(file: &str, bytes: &[u8]) -> Result<Vec<TriangleMesh>, InputError> {
    let text = String::from_utf8_lossy(bytes);
    let mut reader = Reader::default();
    let mut joined = String::new();
    for (i, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim_end();
        if let Some(begun) = line.strip_suffix('\\') {
            joined = joined + begun + " ";
            continue;
        }
        let whole = if joined.is_empty() { line } else { &*(joined + line) };
        reader.line(whole).map_err(|expected| {
            let found = format!("`{}`", whole.trim().chars().take(60).collect::<String>());
            InputError::new(file, format!("line {}", i + 1), found, expected)
        })?;
        joined = String::new();
    }
    reader.close_group();
    if let Some(missing) = reader.highest.checked_sub(reader.places.len() as u32).filter(|it| *it > 0) {
        let found = format!("vertex number {}", reader.places.len() as u32 + missing);
        let expected = format!("indices of the {} vertices", reader.places.len());
        return Err(InputError::new(file, "faces", found, expected));
    }
    // Faces may stand above their vertices.
    let places = reader.places;
    let group = |(indices, triangles): (Vec<u32>, Vec<[u32; 3]>)| {
        let vertices = indices.into_iter().map(|it| places[it as usize]).collect();
        TriangleMesh { vertices, triangles }
    };
    Ok(reader.groups.into_iter().map(group).collect())
}

#[derive(Default)]
struct Reader {
    places: Vec<Point3<f64>>,
    /// Vertices that each group uses, and its triangles between them.
    groups: Vec<(Vec<u32>, Vec<[u32; 3]>)>,
    /// Vertices of the present group by their numbers in the file.
    numbers: HashMap<u32, u32>,
    present: (Vec<u32>, Vec<[u32; 3]>),
    triangles: usize,
    /// The highest index plus one.
    highest: u32,
}

impl Reader {
    /// Reads a line; what would be right is the error.
    fn line(&mut self, line: &str) -> Result<(), String> {
        let line = line.split_once('#').map_or(line, |(before, _)| before);
        let mut words = line.split_whitespace();
        match words.next() {
            None => Ok(()),
            Some("v") => {
                let mut number = || words.next()?.parse::<f32>().ok().map(f64::from);
                let place = (|| Some(Point3::new(number()?, number()?, number()?)))();
                self.places.push(place.ok_or("three numbers")?);
                Ok(())
            }
            Some("f") => self.face(words),
            Some("o" | "g") => {
                self.close_group();
                Ok(())
            }
            Some(keyword) if HARMLESS.split(' ').any(|it| it == keyword) => Ok(()),
            Some(_) => Err("a Wavefront OBJ mesh: v, f, o, g and what is no surface".into()),
        }
    }

    fn face<'a>(&mut self, words: impl Iterator<Item = &'a str>) -> Result<(), String> {
        let mut corners = Vec::new();
        for word in words {
            let index: i64 = word.split('/').next().and_then(|it| it.parse().ok()).ok_or("indices of vertices")?;
            // Below zero they count back from the last vertex so far.
            let from_zero = if index < 0 { self.places.len() as i64 + index } else { index - 1 };
            let index = u32::try_from(from_zero).ok().filter(|it| *it < u32::MAX).ok_or("indices of vertices")?;
            self.highest = self.highest.max(index + 1);
            let (known, vertices) = (&mut self.numbers, &mut self.present.0);
            corners.push(*known.entry(index).or_insert_with(|| {
                vertices.push(index);
                vertices.len() as u32 - 1
            }));
        }
        if corners.len() < 3 {
            return Err("three corners or more".into());
        }
        self.triangles += corners.len() - 2;
        if self.triangles > MOST_TRIANGLES {
            return Err(format!("at most {MOST_TRIANGLES} triangles"));
        }
        self.present.1.extend(corners[1..].windows(2).map(|it| [corners[0], it[0], it[1]]));
        Ok(())
    }

    fn close_group(&mut self) {
        let present = std::mem::take(&mut self.present);
        self.numbers.clear();
        self.groups.extend(Some(present).filter(|(_, triangles)| !triangles.is_empty()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";

    #[test]
    fn files_are_read_however_they_are_written() {
        let whole = read("a.obj", SQUARE.as_bytes()).unwrap();
        assert_eq!(whole[0].triangles, [[0, 1, 2], [0, 2, 3]]);
        for text in [
            SQUARE.replace('\n', "\r\n"),
            format!("\u{feff}{SQUARE}"),
            SQUARE.replace("1 2 3 4", "1 2 \\\n  3 4"),
            SQUARE.replace("1 2 3 4", "-4 -3 -2 -1"),
            SQUARE.replace("1 2 3 4", "1/1/1 2//2 3/3 4 # a face"),
            format!("mtllib a.mtl\n{SQUARE}l 1 2 3\np 1\ncstype bezier\nusemtl \n"),
            format!("f 1 2 3 4\n{}", SQUARE.replace("f 1 2 3 4\n", "")),
        ] {
            assert_eq!(read("a.obj", text.as_bytes()).unwrap(), whole, "{text}");
        }
        let two = read("a.obj", format!("o one\n{SQUARE}g two\nf 4 3 2\n").as_bytes()).unwrap();
        assert_eq!((two.len(), &two[1].vertices[0]), (2, &Point3::new(0.0, 1.0, 0.0)));
        for (text, expected) in [
            ("surf 0 1 0 1 1 2 3\n", "line 1: found `surf"),
            ("v 0 0\n", "three numbers"),
            ("v 0 0 0\nf 1 1 9\n", "faces: found vertex number 9, expected indices of the 1 vertices"),
            ("f 1 2\n", "three corners"),
            ("f 0 1 2\n", "indices"),
            ("Some words\n", "line 1: found `Some words`"),
        ] {
            let fault = read("a.obj", text.as_bytes()).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
