//! Point clouds from files: PLY (text or binary), PCD (text or binary) and XYZ, in metres.

use std::{fs, path::Path};

use catch_body::{InputError, TriangleMesh, mesh_file::mesh_from_bytes};
use catch_sim::object::check_length;
use nalgebra::{Point3, Vector3};

/// Points and, where the file has them, the surface's outward normals there.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CloudFile {
    /// Places in metres; those that are not finite, as sensors write them for what they did not see, are left out.
    pub points: Vec<Point3<f64>>,
    /// One normal per point.
    pub normals: Option<Vec<Vector3<f64>>>,
}

/// Spacing of the points that are laid upon a mesh, in metres.
const MESH_SPACING_M: f64 = 0.001;

/// Reads a cloud by its extension: `.ply`, `.pcd`, `.xyz`, `.txt` or `.csv`; with `meshes` also `.obj` and `.stl`, on whose
/// surface points are laid.
///
/// # Errors
/// A file that cannot be read or that is not what its extension says.
pub fn read(path: &Path, meshes: bool) -> Result<CloudFile, InputError> {
    let file = path.display().to_string();
    let formats =
        if meshes { "a .ply, .pcd or .xyz cloud or an .obj or .stl mesh" } else { "a .ply, .pcd or .xyz cloud" };
    let bytes = fs::read(path).map_err(|fault| InputError::new(&file, "the file", fault, formats))?;
    let extension = path.extension().and_then(|it| it.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "ply" => parse_ply(&file, &bytes),
        "pcd" => parse_pcd(&file, &bytes),
        "xyz" | "txt" | "csv" => parse_xyz(&file, &bytes),
        "obj" | "stl" if meshes => {
            let mesh = mesh_from_bytes(&file, &bytes, 1.0)?;
            let advice =
                "a mesh in millimetres is named by an object file with `scale = 0.001` (`catchingbot new object`)";
            check_length(&file, "the mesh", mesh.aabb().size.max(), advice)?;
            Ok(on_surface(&mesh))
        }
        _ => Err(InputError::new(&file, "extension", format!("`{extension}`"), formats)),
    }
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

/// One column of a table of points.
#[derive(Debug, Clone)]
struct Column {
    name: String,
    bytes: usize,
    /// `f`loat, `i`nteger or `u`nsigned.
    kind: char,
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
            ('f', 4) => f64::from(f32::from_bits(unsigned as u32)),
            ('f', _) => f64::from_bits(unsigned),
            ('i', width) => {
                let shift = 64 - 8 * width as u32;
                (((unsigned << shift) as i64) >> shift) as f64
            }
            _ => unsigned as f64,
        })
    }
}

/// A table of points, after its header.
struct Table<'a> {
    file: &'a str,
    columns: Vec<Column>,
    rows: usize,
    body: &'a [u8],
}

impl Table<'_> {
    fn fault(&self, field: impl Into<String>, found: impl std::fmt::Display, expected: &str) -> InputError {
        InputError::new(self.file, field.into(), found.to_string(), expected.to_owned())
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
        let mut add = |values: &[f64]| {
            let p = Point3::from(xyz.map(|i| values[i]));
            let n = normal.map(|of| Vector3::from(of.map(|i| values[i])));
            let finite = p.coords.iter().all(|value| value.is_finite());
            if finite && n.is_none_or(|n| n.norm() > 0.5 && n.norm() < 2.0) {
                cloud.points.push(p);
                if let (Some(normals), Some(n)) = (&mut cloud.normals, n) {
                    normals.push(n.normalize());
                }
            }
        };
        let mut values = vec![0.0; self.columns.len()];
        match binary {
            None => {
                let text = String::from_utf8_lossy(self.body);
                let mut lines = text.lines().filter(|line| !line.trim().is_empty());
                for row in 0..self.rows {
                    let line = lines.next().ok_or_else(|| self.fault("rows", row, "as many as the header says"))?;
                    let mut cells = line.split_whitespace();
                    for value in &mut values {
                        let cell = cells.next().unwrap_or_default();
                        *value = cell
                            .parse()
                            .map_err(|_| self.fault(format!("row {}", row + 1), format!("`{cell}`"), "a number"))?;
                    }
                    add(&values);
                }
            }
            Some(big_endian) => {
                let stride: usize = self.columns.iter().map(|column| column.bytes).sum();
                for row in 0..self.rows {
                    let mut at = row * stride;
                    for (value, column) in values.iter_mut().zip(&self.columns) {
                        let bytes = self.body.get(at..).and_then(|bytes| column.value(bytes, big_endian));
                        *value = bytes.ok_or_else(|| self.fault("rows", row, "as many as the header says"))?;
                        at += column.bytes;
                    }
                    add(&values);
                }
            }
        }
        Ok(cloud)
    }
}

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
    for line in &lines {
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["format", kind, _] => format = Some(kind.to_owned()),
            ["element", "vertex", count] => {
                let count = count.parse().map_err(|_| fault("element vertex", count, "a number of points"))?;
                (rows, in_vertices) = (Some(count), true);
            }
            ["element", ..] if rows.is_none() => {
                return Err(fault("element", line, "`element vertex` before all others"));
            }
            ["element", ..] => in_vertices = false,
            ["property", "list", ..] if in_vertices => return Err(fault("property", line, "no lists in a vertex")),
            ["property", kind, name] if in_vertices => {
                let (kind, bytes) = match kind {
                    "char" | "int8" => ('i', 1),
                    "uchar" | "uint8" => ('u', 1),
                    "short" | "int16" => ('i', 2),
                    "ushort" | "uint16" => ('u', 2),
                    "int" | "int32" => ('i', 4),
                    "uint" | "uint32" => ('u', 4),
                    "float" | "float32" => ('f', 4),
                    "double" | "float64" => ('f', 8),
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
    Table { file, columns, rows, body }.read(binary)
}

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
        let kind = kinds[i].chars().next().unwrap_or('F').to_ascii_lowercase();
        let count: usize = counts.get(i).map_or(Ok(1), |count| count.parse()).unwrap_or(1);
        columns.extend((0..count.clamp(1, 1024)).map(|_| Column { name: (*name).to_owned(), bytes, kind }));
    }
    let points = entry("POINTS").first().and_then(|count| count.parse().ok());
    let rows = points.ok_or_else(|| fault("POINTS", "none", "a number of points"))?;
    let table = Table { file, columns, rows, body };
    match entry("DATA")[..] {
        ["ascii"] => table.read(None),
        ["binary"] => table.read(Some(false)),
        _ => Err(fault("DATA", &entry("DATA").join(" "), "ascii or binary, not compressed")),
    }
}

/// Lines of x y z, with nx ny nz where there are six columns or more that make unit vectors.
fn parse_xyz(file: &str, bytes: &[u8]) -> Result<CloudFile, InputError> {
    let mut cloud = CloudFile::default();
    let text = String::from_utf8_lossy(bytes);
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let cells = line.split(|c: char| c == ',' || c == ';' || c.is_whitespace()).filter(|cell| !cell.is_empty());
        let values: Vec<Option<f64>> = cells.take(3).map(|cell| cell.parse().ok()).collect();
        match values[..] {
            [Some(x), Some(y), Some(z)] if x.is_finite() && y.is_finite() && z.is_finite() => {
                cloud.points.push(Point3::new(x, y, z));
            }
            [Some(_), Some(_), Some(_)] => {}
            // A header.
            _ if cloud.points.is_empty() && values.iter().all(Option::is_none) => {}
            _ => {
                return Err(InputError::new(
                    file,
                    format!("line {}", number + 1),
                    format!("`{line}`"),
                    "x y z in metres",
                ));
            }
        }
    }
    Ok(cloud)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
                       element face 1\nproperty list uchar int vertex_indices\nend_header\n1 2 3\n4 5 nan\n3 0 1 1\n";

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
        let pcd = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n\
                   POINTS 2\nDATA ascii\n1 2 3\nnan nan nan\n";
        assert_eq!(parse_pcd("c.pcd", pcd.as_bytes()).unwrap().points, expected);
        assert_eq!(parse_xyz("d.xyz", b"x y z\n1 2 3\n").unwrap().points, expected);
    }

    #[test]
    fn broken_files_are_named() {
        for (fault, expected) in [
            (parse_ply("a.ply", b"solid"), "a.ply: header"),
            (parse_ply("a.ply", PLY.replace("1 2 3", "1 b 3").as_bytes()), "row 1"),
            (parse_ply("a.ply", PLY.replace("vertex 2", "vertex 9").as_bytes()), "rows"),
            (parse_pcd("c.pcd", b"DATA binary_compressed\n"), "POINTS"),
            (parse_xyz("d.xyz", b"1 2 3\n1 2\n"), "line 2"),
        ] {
            let fault = fault.unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
