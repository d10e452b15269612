//! Point clouds from files: PLY (text or binary), PCD (text or binary) and XYZ, in metres.

use std::path::Path;

use catch_body::{InputError, TriangleMesh, mesh_file::mesh_from_bytes};
use catch_sim::object::check_length;
use nalgebra::{Point3, Vector3};

use catch_recording::bounded_file::FileKind;

use crate::surface_file::{PlyFile, triangles_from_bytes};

/// Points and, where the file has them, the surface's outward normals there.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CloudFile {
    /// Places in metres; those that are not finite, as sensors write them for what they did not see, are left
    /// out.
    pub points: Vec<Point3<f64>>,
    /// Normals, one per point.
    pub normals: Option<Vec<Vector3<f64>>>,
}

/// Spacing of the points that are laid upon a mesh, in metres.
const MESH_SPACING_M: f64 = 0.001;

/// Reads a cloud by its extension: `.ply`, `.pcd`, `.xyz`, `.txt` or `.csv`; with `meshes` also `.obj`,
/// `.stl` and `.ply` with faces, on whose surface points are laid.
///
/// # Errors
/// A file that cannot be read, that is not what its extension says or that has no point.
pub fn read(path: &Path, meshes: bool) -> Result<CloudFile, InputError> {
    let file = path.display().to_string();
    let formats = formats(meshes);
    parse(&file, &FileKind::geometry(formats).read(path)?, meshes)
}

/// Reads the bytes of a cloud; `file` names it in errors, and its extension tells the format.
///
/// # Errors
/// As [`read`].
pub fn parse(file: &str, bytes: &[u8], meshes: bool) -> Result<CloudFile, InputError> {
    let formats = formats(meshes);
    let extension = Path::new(file).extension().and_then(|it| it.to_str()).unwrap_or_default().to_ascii_lowercase();
    let cloud = match extension.as_str() {
        "ply" if !meshes || PlyFile::from_bytes(file, bytes)?.triangles.is_empty() => parse_ply(file, bytes)?,
        "pcd" => parse_pcd(file, bytes)?,
        "xyz" | "txt" | "csv" => parse_xyz(file, bytes)?,
        "ply" | "obj" | "stl" if meshes => {
            let mesh = if extension == "ply" {
                triangles_from_bytes(file, bytes)?.swap_remove(0)
            } else {
                mesh_from_bytes(file, bytes, 1.0)?
            };
            let advice =
                "a mesh in millimetres needs an object file with `scale = 0.001`, or `catchingbot object import`";
            check_length(file, "the mesh", mesh.aabb().size.max(), advice)?;
            on_surface(&mesh)
        }
        _ => return Err(InputError::new(file, "extension", format!("`{extension}`"), formats)),
    }
    .with_directions();
    if cloud.points.is_empty() {
        return Err(InputError::new(file, "points", "none with finite coordinates", "one or more"));
    }
    Ok(cloud)
}

fn formats(meshes: bool) -> &'static str {
    if meshes { "a .ply, .pcd or .xyz cloud or an .obj, .stl or .ply mesh" } else { "a .ply, .pcd or .xyz cloud" }
}

/// Points laid evenly upon a mesh, by a grid on each triangle.
pub fn on_surface(mesh: &TriangleMesh) -> CloudFile {
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    for [a, b, c] in mesh.all_corners() {
        let across = (b - a).cross(&(c - a));
        let Some(normal) = across.try_normalize(0.0) else { continue };
        let longest = (b - a).norm().max((c - a).norm()).max((c - b).norm());
        let steps = (longest / MESH_SPACING_M).ceil().max(1.0) as u32;
        for i in 0..steps {
            for j in 0..steps - i {
                let fraction = |k: u32| (f64::from(k) + 1.0 / 3.0) / f64::from(steps);
                points.push(a + (b - a) * fraction(i) + (c - a) * fraction(j));
                normals.push(normal);
            }
        }
    }
    CloudFile { points, normals: Some(normals) }
}

/// Coordinates whose magnitude is larger are in no unit of length.
const MOST_COORDINATE_M: f64 = 1e6;

/// Points and normals, one after the other; what no sensor saw is left out.
impl CloudFile {
    fn add(&mut self, p: Point3<f64>, normal: Option<Vector3<f64>>) -> Result<(), String> {
        if !p.coords.iter().all(|value| value.is_finite()) {
            return Ok(());
        }
        if p.coords.amax() > MOST_COORDINATE_M {
            return Err(format!("{:e}", p.coords.amax()));
        }
        if let (Some(normals), Some(normal)) = (&mut self.normals, normal) {
            // The direction counts; zero, and what is no number, is none.
            normals.push(normal.try_normalize(0.0).filter(|it| it.norm().is_finite()).unwrap_or_default());
        }
        self.points.push(p);
        Ok(())
    }

    /// Drops the normals if none of them has a direction, else the points of those that have none.
    fn with_directions(mut self) -> Self {
        let Some(normals) = self.normals.take() else { return self };
        let has_one: Vec<bool> = normals.iter().map(|it| *it != Vector3::zeros()).collect();
        if !has_one.contains(&true) {
            return self;
        }
        let kept = |i: &usize| has_one[*i];
        let (points, all) = (&self.points, 0..normals.len());
        Self {
            points: all.clone().filter(kept).map(|i| points[i]).collect(),
            normals: Some(all.filter(kept).map(|i| normals[i]).collect()),
        }
    }
}

/// Type of a column's numbers in binary.
#[derive(Debug, Clone, Copy, PartialEq)]
enum NumberKind {
    Float,
    Signed,
    Unsigned,
}

/// A column of a table of points.
#[derive(Debug, Clone)]
struct Column {
    name: String,
    bytes: usize,
    kind: NumberKind,
}

impl Column {
    fn value(&self, bytes: &[u8], big_endian: bool) -> Option<f64> {
        let mut raw = [0; 8];
        let bytes = bytes.get(..self.bytes)?;
        raw[..self.bytes].copy_from_slice(bytes);
        if big_endian {
            raw[..self.bytes].reverse();
        }
        let unsigned = u64::from_le_bytes(raw);
        Some(match (self.kind, self.bytes) {
            (NumberKind::Float, 4) => f64::from(f32::from_bits(unsigned as u32)),
            (NumberKind::Float, _) => f64::from_bits(unsigned),
            (NumberKind::Signed, width) => {
                let shift = 64 - 8 * width as u32;
                (((unsigned << shift) as i64) >> shift) as f64
            }
            (NumberKind::Unsigned, _) => unsigned as f64,
        })
    }
}

/// A table of points, after its header.
struct Table<'a> {
    file: &'a str,
    columns: Vec<Column>,
    rows: usize,
    /// True if more may follow the rows: other elements than points.
    more_follows: bool,
    /// Line of the file at which the body begins, counted from one.
    first_line: usize,
    body: &'a [u8],
}

impl Table<'_> {
    fn fault(&self, field: impl Into<String>, found: impl std::fmt::Display, expected: &str) -> InputError {
        InputError::new(self.file, field.into(), found.to_string(), expected.to_owned())
    }

    fn too_few(&self, complete: usize) -> InputError {
        self.fault("rows", complete, &format!("the {} of the header", self.rows))
    }

    fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }

    /// The cloud, its numbers being text or of the given byte order.
    fn read(&self, binary: Option<bool>) -> Result<CloudFile, InputError> {
        let place = |name: &str| {
            self.column(name)
                .ok_or_else(|| self.fault("header", format!("no `{name}`"), "columns x, y and z in metres"))
        };
        let xyz = [place("x")?, place("y")?, place("z")?];
        let either = |one: &str, two: &str| self.column(one).or_else(|| self.column(two));
        let normal = [either("nx", "normal_x"), either("ny", "normal_y"), either("nz", "normal_z")];
        let normal = if let [Some(x), Some(y), Some(z)] = normal { Some([x, y, z]) } else { None };
        let mut cloud = CloudFile { points: Vec::new(), normals: normal.map(|_| Vec::new()) };
        let mut add = |field: &dyn Fn() -> String, values: &[f64]| {
            let p = Point3::from(xyz.map(|i| values[i]));
            let n = normal.map(|of| Vector3::from(of.map(|i| values[i])));
            cloud.add(p, n).map_err(|found| self.fault(field(), found, "a coordinate in metres"))
        };
        match binary {
            None => self.read_text(&mut add)?,
            Some(big_endian) => self.read_binary(big_endian, &mut add)?,
        }
        Ok(cloud)
    }

    /// Hands over the numbers of each row, with a name for its place.
    fn read_text(&self, add: &mut AddRow<'_>) -> Result<(), InputError> {
        let mut values = vec![0.0; self.columns.len()];
        let text = String::from_utf8_lossy(self.body);
        let numbered = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let mut lines = numbered.map(|(i, line)| (self.first_line + i, line));
        for row in 0..self.rows {
            let (number, line) = lines.next().ok_or_else(|| self.too_few(row))?;
            let field = || format!("line {number}");
            let mut cells = line.split_whitespace();
            for (value, column) in values.iter_mut().zip(&self.columns) {
                let cell = cells.next().unwrap_or_default();
                let expected = format!("a number: the {}", column.name);
                *value = cell.parse().map_err(|_| self.fault(field(), format!("`{cell}`"), &expected))?;
            }
            if cells.next().is_some() {
                let expected = format!("{} numbers, as the header says", self.columns.len());
                return Err(self.fault(field(), format!("`{line}`"), &expected));
            }
            add(&field, &values)?;
        }
        match lines.next().filter(|_| !self.more_follows) {
            None => Ok(()),
            Some((number, line)) => {
                let expected = format!("no more than the {} rows of the header", self.rows);
                Err(self.fault(format!("line {number}"), format!("`{line}`"), &expected))
            }
        }
    }

    /// Reads rows of numbers in binary.
    fn read_binary(&self, big_endian: bool, add: &mut AddRow<'_>) -> Result<(), InputError> {
        let mut values = vec![0.0; self.columns.len()];
        let stride: usize = self.columns.iter().map(|column| column.bytes).sum();
        let complete = self.body.len() / stride.max(1);
        if complete < self.rows {
            return Err(self.too_few(complete));
        }
        let more = self.body.len() - stride * self.rows;
        if !self.more_follows && more > 0 {
            let expected = format!("no more than the {} rows of the header", self.rows);
            return Err(self.fault("rows", format!("{more} bytes more"), &expected));
        }
        for row in 0..self.rows {
            let mut at = row * stride;
            for (value, column) in values.iter_mut().zip(&self.columns) {
                let bytes = self.body.get(at..).and_then(|bytes| column.value(bytes, big_endian));
                *value = bytes.ok_or_else(|| self.too_few(row))?;
                at += column.bytes;
            }
            add(&|| format!("row {}", row + 1), &values)?;
        }
        Ok(())
    }
}

/// Takes the numbers of a row; the first function names its place.
type AddRow<'a> = dyn FnMut(&dyn Fn() -> String, &[f64]) -> Result<(), InputError> + 'a;

/// Splits the header, up to and with the first line for which `is_last` holds, from the rest.
fn split_header(bytes: &[u8], is_last: impl Fn(&str) -> bool) -> Option<(Vec<String>, &[u8])> {
    let (mut lines, mut at) = (Vec::new(), 0);
    while let Some(length) = bytes[at..].iter().take(10_000).position(|&byte| byte == b'\n') {
        let line = String::from_utf8_lossy(&bytes[at..at + length]).trim().to_owned();
        at += length + 1;
        let last = is_last(&line);
        lines.push(line);
        if last {
            return Some((lines, &bytes[at..]));
        }
    }
    None
}

fn parse_ply(file: &str, bytes: &[u8]) -> Result<CloudFile, InputError> {
    let fault = |field: &str, found: &str, expected: &str| InputError::new(file, field, found, expected);
    let header = split_header(bytes, |line| line == "end_header").filter(|(lines, _)| lines[0] == "ply");
    let (lines, body) = header.ok_or_else(|| fault("header", "no PLY header", "`ply` … `end_header`"))?;
    let (mut columns, mut rows, mut format, mut in_vertices) = (Vec::new(), None, None, false);
    let mut more_follows = false;
    for line in &lines {
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["format", kind, _] => format = Some(kind.to_owned()),
            ["element", "vertex", _] if rows.is_some() => return Err(fault("element vertex", "a second one", "one")),
            ["element", "vertex", count] => {
                let count = count.parse().map_err(|_| fault("element vertex", count, "a number of points"))?;
                (rows, in_vertices) = (Some(count), true);
            }
            ["element", ..] if rows.is_none() => {
                return Err(fault("element", line, "`element vertex` before all others"));
            }
            ["element", ..] => (in_vertices, more_follows) = (false, true),
            ["property", "list", ..] if in_vertices => return Err(fault("property", line, "no lists in a vertex")),
            ["property", kind, name] if in_vertices => {
                let (kind, bytes) = match kind {
                    "char" | "int8" => (NumberKind::Signed, 1),
                    "uchar" | "uint8" => (NumberKind::Unsigned, 1),
                    "short" | "int16" => (NumberKind::Signed, 2),
                    "ushort" | "uint16" => (NumberKind::Unsigned, 2),
                    "int" | "int32" => (NumberKind::Signed, 4),
                    "uint" | "uint32" => (NumberKind::Unsigned, 4),
                    "float" | "float32" => (NumberKind::Float, 4),
                    "double" | "float64" => (NumberKind::Float, 8),
                    _ => return Err(fault("property", kind, "char, short, int, float or double")),
                };
                columns.push(Column { name: name.to_owned(), bytes, kind });
            }
            _ => {}
        }
    }
    let binary = match format.as_deref() {
        Some("ascii") => None,
        Some("binary_little_endian") => Some(false),
        Some("binary_big_endian") => Some(true),
        other => return Err(fault("format", other.unwrap_or("none"), "ascii or binary")),
    };
    let rows = rows.ok_or_else(|| fault("header", "no vertices", "`element vertex N`"))?;
    Table { file, columns, rows, more_follows, first_line: lines.len() + 1, body }.read(binary)
}

/// Numbers of one column of a PCD file at most.
const MOST_COUNT: usize = 1024;

fn parse_pcd(file: &str, bytes: &[u8]) -> Result<CloudFile, InputError> {
    let fault = |field: &str, found: &str, expected: &str| InputError::new(file, field, found, expected);
    let header = split_header(bytes, |line| line.starts_with("DATA"));
    let (lines, body) = header.ok_or_else(|| fault("header", "no PCD header", "`FIELDS` … `DATA`"))?;
    let entry = |key: &str| -> Vec<&str> {
        let line = lines.iter().find(|line| line.split_whitespace().next() == Some(key));
        line.map(|line| line.split_whitespace().skip(1).collect()).unwrap_or_default()
    };
    let (names, sizes, kinds, counts) = (entry("FIELDS"), entry("SIZE"), entry("TYPE"), entry("COUNT"));
    if names.len() != sizes.len() || names.len() != kinds.len() {
        return Err(fault("FIELDS, SIZE, TYPE", "different lengths", "one entry each per column"));
    }
    let mut columns = Vec::new();
    for (i, name) in names.iter().enumerate() {
        let bytes = sizes[i].parse().ok().filter(|bytes| matches!(bytes, 1 | 2 | 4 | 8));
        let bytes = bytes.ok_or_else(|| fault("SIZE", sizes[i], "1, 2, 4 or 8"))?;
        let kind = match (kinds[i], bytes) {
            ("F", 4 | 8) => NumberKind::Float,
            ("I", _) => NumberKind::Signed,
            ("U", _) => NumberKind::Unsigned,
            (kind, _) => return Err(fault("TYPE", &format!("{kind} of {bytes} bytes"), "F of 4 or 8 bytes, I or U")),
        };
        let count = counts.get(i).copied().unwrap_or("1");
        let count = count
            .parse()
            .ok()
            .filter(|count| (1..=MOST_COUNT).contains(count))
            .ok_or_else(|| fault("COUNT", count, &format!("1 to {MOST_COUNT}")))?;
        columns.extend((0..count).map(|_| Column { name: (*name).to_owned(), bytes, kind }));
    }
    if !counts.is_empty() && counts.len() != names.len() {
        return Err(fault("COUNT", &format!("{} entries", counts.len()), "one entry per column"));
    }
    let points = entry("POINTS");
    let rows = points.first().and_then(|count| count.parse().ok());
    let rows = rows.ok_or_else(|| fault("POINTS", points.first().unwrap_or(&"none"), "a number of points"))?;
    let table = Table { file, columns, rows, more_follows: false, first_line: lines.len() + 1, body };
    match entry("DATA")[..] {
        ["ascii"] => table.read(None),
        ["binary"] => table.read(Some(false)),
        _ => Err(fault("DATA", &format!("`{}`", entry("DATA").join(" ")), "ascii or binary, not compressed")),
    }
}

/// Lines of x y z; what follows on a line, such as a colour, is left out, and one line of words may stand
/// above.
fn parse_xyz(file: &str, bytes: &[u8]) -> Result<CloudFile, InputError> {
    let mut cloud = CloudFile::default();
    let text = String::from_utf8_lossy(bytes);
    let mut may_be_header = true;
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let cells = line.split(|c: char| c == ',' || c == ';' || c.is_whitespace()).filter(|cell| !cell.is_empty());
        let values: Vec<Option<f64>> = cells.take(3).map(|cell| cell.parse().ok()).collect();
        let is_header = std::mem::take(&mut may_be_header) && values.iter().all(Option::is_none);
        let fault = |found: String| InputError::new(file, format!("line {}", number + 1), found, "x y z in metres");
        match values[..] {
            [Some(x), Some(y), Some(z)] => cloud.add(Point3::new(x, y, z), None).map_err(fault)?,
            _ if is_header => {}
            _ => return Err(fault(format!("`{}`", line.chars().take(80).collect::<String>()))),
        }
    }
    Ok(cloud)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
                       element face 1\nproperty list uchar int vertex_indices\nend_header\n1 2 3\n4 5 nan\n3 0 1 1\n";

    const NO_FACES: &str = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                            end_header\n1 2 3\n";
    const PCD: &str = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n\
                       POINTS 2\nDATA ascii\n1 2 3\nnan nan nan\n";

    #[test]
    fn all_formats_give_the_same_points() {
        let expected = [Point3::new(1.0, 2.0, 3.0)];
        assert_eq!(parse_ply("a.ply", PLY.as_bytes()).unwrap().points, expected);
        let header = PLY.replace("ascii", "binary_little_endian");
        let mut bytes = header.split_once("1 2 3").unwrap().0.as_bytes().to_vec();
        for value in [1.0f32, 2.0, 3.0, 4.0, 5.0, f32::NAN] {
            bytes.extend(value.to_le_bytes());
        }
        assert_eq!(parse_ply("b.ply", &bytes).unwrap().points, expected);
        assert_eq!(parse_pcd("c.pcd", PCD.as_bytes()).unwrap().points, expected);
        assert_eq!(parse_xyz("d.xyz", b"x y z\n1 2 3\n").unwrap().points, expected);
    }

    #[test]
    fn broken_files_are_named() {
        for (fault, expected) in [
            (parse_ply("a.ply", b"solid"), "a.ply: header"),
            (
                parse_ply("a.ply", PLY.replace("1 2 3", "1 b 3").as_bytes()),
                "line 10: found `b`, expected a number: the y",
            ),
            (parse_ply("a.ply", PLY.replace("1 2 3", "1 2 3 4").as_bytes()), "line 10: found `1 2 3 4`"),
            (parse_ply("a.ply", PLY.replace("1 2 3", "1 2 1e300").as_bytes()), "line 10: found 1e300"),
            (
                parse_ply("a.ply", (NO_FACES.to_owned() + "7 8 9\n").as_bytes()),
                "line 9: found `7 8 9`, expected no more",
            ),
            (parse_pcd("c.pcd", PCD.replace("TYPE F F F", "TYPE F Q F").as_bytes()), "TYPE: found Q of 4 bytes"),
            (parse_pcd("c.pcd", PCD.replace("COUNT 1 1 1", "COUNT 1 -1 1").as_bytes()), "COUNT: found -1"),
            (parse_pcd("c.pcd", PCD.replace("POINTS 2", "POINTS two").as_bytes()), "POINTS: found two"),
            (parse_xyz("d.xyz", b"a b c\nd e f\n1 2 3\n"), "line 2: found `d e f`"),
            (parse_ply("a.ply", PLY.replace("vertex 2", "vertex 9").as_bytes()), "line 12: found `3 0 1 1`"),
            (
                parse_ply("a.ply", NO_FACES.replace("vertex 1", "vertex 9").as_bytes()),
                "rows: found 1, expected the 9 of the header",
            ),
            (parse_pcd("c.pcd", b"DATA binary_compressed\n"), "POINTS"),
            (parse_xyz("d.xyz", b"1 2 3\n1 2\n"), "line 2"),
        ] {
            let fault = fault.unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
