//! Reads PLY files, text or binary: vertices, their normals, and the polygons between them.

use catch_body::{InputError, TriangleMesh, mesh_file::MOST_TRIANGLES};
use nalgebra::{Point3, Vector3};

use crate::row_numbers::{Encoding, Number, Numbers, split_header};

/// Elements of one kind at most.
const MOST_ROWS: usize = 20_000_000;
/// Elements with no surface in them, which are passed over.
const HARMLESS: [&str; 4] = ["edge", "camera", "material", "range_grid"];

/// Contents of a PLY file, or of another with points in rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlyFile {
    /// Places in the unit of the file, and the triangles between them; polygons are cut into fans.
    pub mesh: TriangleMesh,
    /// Normals of the vertices, where the file has them.
    pub normals: Option<Vec<Vector3<f64>>>,
}

/// A number in each row of an element, or a list.
pub(crate) struct Property {
    pub name: String,
    /// The type of a list's length, if it is one.
    pub length: Option<Number>,
    pub of: Number,
}

/// Rows of one kind: `vertex` and `points` have places, `face` and `tristrips` triangles.
pub(crate) struct Element {
    pub name: String,
    pub rows: usize,
    pub properties: Vec<Property>,
}

impl PlyFile {
    /// Reads a file; `file` names it in errors.
    ///
    /// # Errors
    /// If it is no PLY file, ends early, or has vertices without x, y and z.
    pub fn from_bytes(file: &str, bytes: &[u8]) -> Result<Self, InputError> {
        let fault = |field: &str, found: &str, expected: &str| InputError::new(file, field, found, expected);
        let header = split_header(bytes, |line| line == "end_header").filter(|(lines, _)| lines[0] == "ply");
        let (lines, at) = header.ok_or_else(|| fault("header", "no PLY header", "`ply` … `end_header`"))?;
        let (encoding, elements) = self::header(file, &lines)?;
        let mut numbers = Numbers { file, encoding, bytes, at };
        let mut ply = Self::default();
        for element in &elements {
            ply.add(element, &mut numbers)?;
        }
        numbers.finish()?;
        Ok(ply)
    }

    /// Reads the rows of an element.
    ///
    /// # Errors
    /// A number that is missing or none, too many triangles, or places without x, y and z.
    pub(crate) fn add(&mut self, element: &Element, numbers: &mut Numbers) -> Result<(), InputError> {
        let has = |axis: &str| element.properties.iter().any(|it| it.length.is_none() && it.name == axis);
        if has_places(element) && element.rows > 0 && !["x", "y", "z"].into_iter().all(has) {
            let field = format!("element {}", element.name);
            return Err(InputError::new(numbers.file, field, "no x, y or z", "properties x, y and z"));
        }
        if has_places(element) && !self.mesh.vertices.is_empty() {
            let field = format!("element {}", element.name);
            return Err(InputError::new(numbers.file, field, "it twice", "one element of places"));
        }
        for row in 0..element.rows {
            self.row(element, numbers, row)?;
            if self.mesh.triangles.len() > MOST_TRIANGLES {
                let expected = format!("at most {MOST_TRIANGLES}");
                return Err(InputError::new(numbers.file, "faces", "more triangles", expected));
            }
        }
        Ok(())
    }

    /// Reads one row of an element.
    fn row(&mut self, element: &Element, numbers: &mut Numbers, row: usize) -> Result<(), InputError> {
        let missing = |numbers: &Numbers| numbers.missing(&element.name, row, element.rows);
        let (mut place, mut normal) = ([None; 3], [None; 3]);
        for property in &element.properties {
            let Some(length) = property.length else {
                let value = numbers.next(property.of).ok_or_else(|| missing(numbers))?;
                let axis = |name: &str| ["x", "y", "z"].iter().position(|it| *it == name);
                let name = property.name.as_str();
                if let Some(axis) = axis(name) {
                    place[axis] = Some(value);
                } else if let Some(axis) = name.strip_prefix("normal_").or(name.strip_prefix('n')).and_then(axis) {
                    normal[axis] = Some(value);
                }
                continue;
            };
            let count = numbers.next(length).filter(|it| (0.0..=MOST_ROWS as f64).contains(it) && it.fract() == 0.0);
            let count = count.ok_or_else(|| missing(numbers))? as usize;
            let is_surface = matches!(property.name.as_str(), "vertex_indices" | "vertex_index");
            let mut corners = Vec::new();
            for _ in 0..count {
                let value = numbers.next(property.of).ok_or_else(|| missing(numbers))?;
                if is_surface {
                    let ends_strip = value == -1.0 && element.name == "tristrips";
                    if !ends_strip && (value < 0.0 || value.fract() != 0.0) {
                        let field = format!("{} {}", element.name, row + 1);
                        return Err(InputError::new(numbers.file, field, value, "numbers of vertices, from 0"));
                    }
                    corners.push(if ends_strip { u32::MAX } else { value as u32 });
                }
            }
            let triangles = &mut self.mesh.triangles;
            match element.name.as_str() {
                "face" => triangles.extend(fan(&corners)),
                "tristrips" => corners.split(|it| *it == u32::MAX).for_each(|it| triangles.extend(strip(it))),
                _ => {}
            }
        }
        if has_places(element) {
            if let [Some(x), Some(y), Some(z)] = place {
                self.mesh.vertices.push(Point3::new(x, y, z));
            }
            if let [Some(x), Some(y), Some(z)] = normal {
                self.normals.get_or_insert_default().push(Vector3::new(x, y, z));
            }
        }
        Ok(())
    }
}

fn has_places(element: &Element) -> bool {
    matches!(element.name.as_str(), "vertex" | "points")
}

/// The triangles of a polygon.
pub(super) fn fan(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> {
    (2..corners.len()).map(|i| [corners[0], corners[i - 1], corners[i]])
}

/// The triangles of a strip, all facing one way.
pub(super) fn strip(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> {
    corners.windows(3).enumerate().map(|(i, it)| if i % 2 == 0 { [it[0], it[1], it[2]] } else { [it[1], it[0], it[2]] })
}

/// Encoding and elements, as the lines of a header say.
fn header(file: &str, lines: &[String]) -> Result<(Encoding, Vec<Element>), InputError> {
    let fault = |field: &str, found: &str, expected: &str| InputError::new(file, field, found, expected);
    let number = |name: &str| {
        let number = match name {
            "char" | "int8" => Number::I8,
            "uchar" | "uint8" => Number::U8,
            "short" | "int16" => Number::I16,
            "ushort" | "uint16" => Number::U16,
            "int" | "int32" => Number::I32,
            "uint" | "uint32" => Number::U32,
            "float" | "float32" => Number::F32,
            "double" | "float64" => Number::F64,
            _ => return Err(fault("property", name, "char, short, int, float or double")),
        };
        Ok(number)
    };
    let (mut encoding, mut elements) = (None, Vec::<Element>::new());
    for line in lines {
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["format", "ascii", "1.0"] => encoding = Some(Encoding::Text),
            ["format", "binary_little_endian", "1.0"] => encoding = Some(Encoding::LittleEndian),
            ["format", "binary_big_endian", "1.0"] => encoding = Some(Encoding::BigEndian),
            ["format", ..] => return Err(fault("format", line, "ascii or binary, version 1.0")),
            ["element", name, count] => {
                let rows = count.parse().ok().filter(|it| *it <= MOST_ROWS);
                let rows = rows.ok_or_else(|| fault("element", line, &format!("at most {MOST_ROWS} rows")))?;
                elements.push(Element { name: name.to_owned(), rows, properties: Vec::new() });
            }
            ["property", ref kind @ .., name] => {
                let (length, of) = match kind {
                    ["list", length, of] => (Some(number(length)?), number(of)?),
                    [of] => (None, number(of)?),
                    _ => return Err(fault("property", line, "a type and a name")),
                };
                let element = elements.last_mut().ok_or_else(|| fault("property", line, "an element before"))?;
                element.properties.push(Property { name: name.to_owned(), length, of });
            }
            ["ply" | "end_header"] | ["comment" | "obj_info", ..] | [] => {}
            _ => return Err(fault("header", line, "format, comment, element or property")),
        }
    }
    for element in &elements {
        let is_surface = matches!(element.name.as_str(), "face" | "tristrips");
        let has_list = element.properties.iter().any(|it| matches!(&*it.name, "vertex_indices" | "vertex_index"));
        if is_surface && element.rows > 0 && !has_list {
            return Err(fault(&format!("element {}", element.name), "no vertex_indices", "a list of vertices"));
        }
        if !is_surface && element.name != "vertex" && element.rows > 0 && !HARMLESS.contains(&&*element.name) {
            return Err(fault("element", &element.name, "vertex, face or tristrips: no other element is read"));
        }
    }
    // A row without properties takes no bytes, so their number would be bounded by nothing.
    elements.retain(|it| !it.properties.is_empty());
    let encoding = encoding.ok_or_else(|| fault("format", "none that is known", "ascii or binary"))?;
    Ok((encoding, elements))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "ply\nformat ascii 1.0\ncomment a square\nelement vertex 4\nproperty float x\nproperty float y\n\
        property double z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";

    #[test]
    fn text_and_binary_are_the_same_square() {
        let text = HEADER.to_owned() + "0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0.5 9\n4 0 1 2 3\n";
        let ply = PlyFile::from_bytes("a.ply", text.as_bytes()).unwrap();
        assert_eq!(
            (ply.mesh.vertices[3], &ply.mesh.triangles[..]),
            (Point3::new(0.0, 1.0, 0.5), &[[0, 1, 2], [0, 2, 3]][..])
        );
        for (encoding, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
            let mut bytes = HEADER.replace("ascii", encoding).into_bytes();
            let mut add = |mut number: Vec<u8>| {
                if big {
                    number.reverse();
                }
                bytes.extend(number);
            };
            for p in &ply.mesh.vertices {
                add((p.x as f32).to_le_bytes().to_vec());
                add((p.y as f32).to_le_bytes().to_vec());
                add(p.z.to_le_bytes().to_vec());
                add(vec![9]);
            }
            add(vec![4]);
            (0..4i32).for_each(|index| add(index.to_le_bytes().to_vec()));
            assert_eq!(PlyFile::from_bytes("a.ply", &bytes).unwrap(), ply);
        }
    }

    #[test]
    fn normals_have_short_and_long_names() {
        for prefix in ["n", "normal_"] {
            let names = ["x", "y", "z"].map(|axis| format!("property float {prefix}{axis}\n")).concat();
            let text = HEADER.replace("property uchar red\n", &names).replace("vertex 4", "vertex 1");
            let ply = PlyFile::from_bytes("a.ply", (text + "7 8 9 0 0 1\n3 0 0 0\n").as_bytes()).unwrap();
            assert_eq!(
                (ply.mesh.vertices, ply.normals),
                (vec![Point3::new(7.0, 8.0, 9.0)], Some(vec![Vector3::z()])),
                "{prefix}"
            );
        }
    }

    #[test]
    fn broken_files_are_named() {
        let text = HEADER.to_owned() + "0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0.5 9\n4 0 1 2 3\n";
        for (text, expected) in [
            (text.replace("4 0 1 2 3\n", "4 0 1\n"), "rows of face: found 0"),
            (text.clone() + "3 0 1 2\n", "line 17: found `3`, expected no more than the rows of the header"),
            (text.replace("4 0 1 2 3", "4 0 1 2.5 3"), "face 1: found 2.5, expected numbers of vertices"),
            (text.replace("4 0 1 2 3", "4 0 1 -1 3"), "face 1: found -1, expected"),
            (text.replace("ascii 1.0", "ascii 2.0"), "format: found format ascii 2.0"),
            (text.replace("vertex 4", "vertex 99999999999"), "element: found"),
            (text.replace("property float y", "property float q"), "no x, y or z"),
            (
                text.replace(
                    "element face 1\n",
                    "element vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n",
                )
                .replace("4 0 1 2 3\n", "5 5 5\n4 0 1 2 3\n"),
                "element vertex: found it twice",
            ),
            (text.replace("uchar red", "colour red"), "property: found colour"),
            (text.replace("ascii", "zip"), "format: "),
            ("ply\n".to_owned(), "no PLY header"),
            (text.replace("element face", "element patch"), "element: found patch"),
            (text.replace("vertex_indices", "corners"), "element face: found no vertex_indices"),
            (text.replace("comment a square", "colour a square"), "header: found colour a square"),
        ] {
            let fault = PlyFile::from_bytes("a.ply", text.as_bytes()).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }

    #[test]
    fn comments_may_say_anything_and_strips_are_surfaces() {
        let body = "0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0.5 9\n";
        let text = HEADER.replace("a square", "before end_header") + body + "4 0 1 2 3\n";
        let ply = PlyFile::from_bytes("a.ply", text.as_bytes()).unwrap();
        assert_eq!(ply.mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        let strips =
            HEADER.replace("face", "tristrips").replace("uchar int", "int int") + body + "8 0 1 3 2 -1 0 1 2\n";
        let ply = PlyFile::from_bytes("a.ply", strips.as_bytes()).unwrap();
        assert_eq!(ply.mesh.triangles, [[0, 1, 3], [3, 1, 2], [0, 1, 2]]);
    }
}
