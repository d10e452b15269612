//! Point clouds from files: PLY (text or binary), PCD (text or binary) and XYZ, in metres.

use std::path::Path;

use catch_body::{
    InputError, TriangleMesh,
    document::Document,
    mesh_file::{checked, extension, mesh_from_bytes},
};
use catch_sim::object::check_length;
use nalgebra::{Point3, Vector3};

use catch_recording::bounded_file::FileKind;

use crate::{
    row_numbers::{Encoding, Number, Numbers, split_header},
    surface_file::{Element, PlyFile, Property},
};

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
    let extension = extension(file);
    let cloud = match extension.as_str() {
        "ply" => {
            let ply = PlyFile::from_bytes(file, bytes)?;
            if meshes && !ply.mesh.triangles.is_empty() {
                of_mesh(file, &checked(file, vec![ply.mesh])?[0])?
            } else {
                of_ply(file, &ply)?
            }
        }
        "pcd" => parse_pcd(file, bytes)?,
        "xyz" | "txt" | "csv" => parse_xyz(file, bytes)?,
        "obj" | "stl" if meshes => of_mesh(file, &mesh_from_bytes(file, bytes, 1.0)?)?,
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

fn of_mesh(file: &str, mesh: &TriangleMesh) -> Result<CloudFile, InputError> {
    let advice = "a mesh in millimetres needs an object file with `scale = 0.001`, or `catchingbot object import`";
    check_length(file, "the mesh", mesh.aabb().size.max(), advice)?;
    Ok(on_surface(mesh))
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
        if normals.iter().all(|it| *it == Vector3::zeros()) {
            return self;
        }
        let pairs = self.points.into_iter().zip(normals).filter(|(_, normal)| *normal != Vector3::zeros());
        let (points, normals) = pairs.unzip();
        Self { points, normals: Some(normals) }
    }
}

/// The points of a file with rows of them.
fn of_ply(file: &str, ply: &PlyFile) -> Result<CloudFile, InputError> {
    let mut cloud = CloudFile { points: Vec::new(), normals: ply.normals.as_ref().map(|_| Vec::new()) };
    for (i, place) in ply.mesh.vertices.iter().enumerate() {
        let normal = ply.normals.as_ref().map(|it| it[i]);
        cloud.add(*place, normal).map_err(|found| no_place(file, i, found))?;
    }
    Ok(cloud)
}

fn no_place(file: &str, row: usize, found: String) -> InputError {
    InputError::new(file, format!("point {}", row + 1), found, "a coordinate in metres")
}

/// Numbers of a point of a PCD file at most.
const MOST_COUNT: usize = 1024;

fn parse_pcd(file: &str, bytes: &[u8]) -> Result<CloudFile, InputError> {
    let fault = |field: &str, found: &str, expected: &str| InputError::new(file, field, found, expected);
    let header = split_header(bytes, |line| line.starts_with("DATA"));
    let (lines, at) = header.ok_or_else(|| fault("header", "no PCD header", "`FIELDS` … `DATA`"))?;
    let entry = |key: &str| -> Vec<&str> {
        let line = lines.iter().find(|line| line.split_whitespace().next() == Some(key));
        line.map(|line| line.split_whitespace().skip(1).collect()).unwrap_or_default()
    };
    let properties = pcd_columns(file, entry)?;
    let points = entry("POINTS");
    let number = |key| entry(key).first().and_then(|count| count.parse::<usize>().ok());
    let rows = number("POINTS");
    let rows = rows.ok_or_else(|| fault("POINTS", points.first().unwrap_or(&"none"), "a number of points"))?;
    if let (Some(width), Some(height)) = (number("WIDTH"), number("HEIGHT"))
        && width.checked_mul(height) != Some(rows)
    {
        return Err(fault("POINTS", &rows.to_string(), &format!("WIDTH · HEIGHT, {width} · {height}")));
    }
    let encoding = match entry("DATA")[..] {
        ["ascii"] => Encoding::Text,
        ["binary"] => Encoding::LittleEndian,
        _ => {
            let found = format!("`{}`", entry("DATA").join(" "));
            return Err(fault("DATA", &found, "ascii or binary, not compressed"));
        }
    };
    let (mut points, mut numbers) = (PlyFile::default(), Numbers { file, encoding, bytes, at });
    points.add(&Element { name: "points".to_owned(), rows, properties }, &mut numbers)?;
    numbers.finish()?;
    of_ply(file, &points)
}

/// Columns of a PCD file, as the entries of its header say.
fn pcd_columns<'a>(file: &str, entry: impl Fn(&str) -> Vec<&'a str>) -> Result<Vec<Property>, InputError> {
    let fault = |field: &str, found: &str, expected: &str| InputError::new(file, field, found, expected);
    let (names, sizes, kinds, counts) = (entry("FIELDS"), entry("SIZE"), entry("TYPE"), entry("COUNT"));
    if names.len() != sizes.len() || names.len() != kinds.len() {
        return Err(fault("FIELDS, SIZE, TYPE", "different lengths", "one entry each per column"));
    }
    let mut columns: Vec<Property> = Vec::new();
    for (i, name) in names.iter().enumerate() {
        let of = match (kinds[i], sizes[i]) {
            ("F", "4") => Number::F32,
            ("F", "8") => Number::F64,
            ("I", "1") => Number::I8,
            ("I", "2") => Number::I16,
            ("I", "4") => Number::I32,
            ("I", "8") => Number::I64,
            ("U", "1") => Number::U8,
            ("U", "2") => Number::U16,
            ("U", "4") => Number::U32,
            ("U", "8") => Number::U64,
            (kind, bytes) => {
                let found = format!("{kind} of {bytes} bytes");
                return Err(fault("TYPE", &found, "F of 4 or 8 bytes, I or U of 1, 2, 4 or 8"));
            }
        };
        let count = counts.get(i).copied().unwrap_or("1");
        let count = count
            .parse()
            .ok()
            .filter(|count| (1..=MOST_COUNT).contains(count))
            .ok_or_else(|| fault("COUNT", count, &format!("1 to {MOST_COUNT}")))?;
        columns.extend((0..count).map(|_| Property { name: (*name).to_owned(), length: None, of }));
        if columns.len() > MOST_COUNT {
            return Err(fault("COUNT", "more numbers", &format!("at most {MOST_COUNT} of a point")));
        }
    }
    if !counts.is_empty() && counts.len() != names.len() {
        return Err(fault("COUNT", &format!("{} entries", counts.len()), "one entry per column"));
    }
    Ok(columns)
}

/// Lines of x y z, or of what the first line names. Behind them may be unit normals; what else follows, such
/// as a colour, is left out.
fn parse_xyz(file: &str, bytes: &[u8]) -> Result<CloudFile, InputError> {
    let mut cloud = CloudFile { points: Vec::new(), normals: Some(Vec::new()) };
    let mut table = None;
    // Without a name, other numbers than normals may stand there.
    let mut are_normals = true;
    let text = String::from_utf8_lossy(bytes);
    for (number, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let cells = line.split(|c: char| c == ',' || c == ';' || c.is_whitespace()).filter(|cell| !cell.is_empty());
        let cells: Vec<&str> = cells.collect();
        if table.is_none() && cells.iter().all(|it| it.parse::<f64>().is_err()) {
            table = Some(XyzColumns::of_header(file, number + 1, &cells)?);
            continue;
        }
        let columns = table.get_or_insert_with(|| XyzColumns::unnamed(cells.len()));
        let fault =
            |found: String, expected: &str| InputError::new(file, format!("line {}", number + 1), found, expected);
        let three = |of: [usize; 3]| -> Option<[f64; 3]> {
            let values: Option<Vec<f64>> = of.iter().map(|i| cells.get(*i)?.parse().ok()).collect();
            values?.try_into().ok()
        };
        let shown = || format!("`{}`", line.chars().take(80).collect::<String>());
        let p: Point3<f64> = three(columns.place).ok_or_else(|| fault(shown(), "x y z in metres"))?.into();
        if cells.len() != columns.count {
            let expected = format!("the {} of the first row", columns.count);
            return Err(fault(format!("{} columns", cells.len()), &expected));
        }
        let normal = columns.normal.map(|of| three(of).map(Vector3::from).unwrap_or_default());
        let is_unit = |it: Vector3<f64>| (it.norm() - 1.0).abs() < 0.01;
        are_normals &= columns.are_named || normal.is_some_and(is_unit) || !p.coords.sum().is_finite();
        cloud.add(p, normal).map_err(|found| fault(found, "x y z in metres"))?;
    }
    cloud.normals = cloud.normals.filter(|it| are_normals && it.len() == cloud.points.len());
    Ok(cloud)
}

/// Columns of a place and a normal in rows of so many.
struct XyzColumns {
    place: [usize; 3],
    normal: Option<[usize; 3]>,
    are_named: bool,
    count: usize,
}

impl XyzColumns {
    fn unnamed(count: usize) -> Self {
        Self { place: [0, 1, 2], normal: (count >= 6).then_some([3, 4, 5]), are_named: false, count }
    }

    fn of_header(file: &str, line: usize, header: &[&str]) -> Result<Self, InputError> {
        let document = Document::from_columns(file, line, header)?;
        let three = |names: [[&'static str; 2]; 3]| {
            let [x, y, z] = names.map(|it| document.column(&it));
            Some([x?, y?, z?])
        };
        let place = three([["x", "x_m"], ["y", "y_m"], ["z", "z_m"]]).ok_or_else(|| {
            let found = format!("columns {}", header.join(" "));
            InputError::new(file, format!("line {line}"), found, "x y z in metres, among others under their names")
        })?;
        let normal = three([["nx", "normal_x"], ["ny", "normal_y"], ["nz", "normal_z"]]);
        Ok(Self { place, normal, are_named: true, count: header.len() })
    }
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
        assert_eq!(parse("a.ply", PLY.as_bytes(), false).unwrap().points, expected);
        let header = PLY.replace("ascii", "binary_little_endian");
        let mut bytes = header.split_once("1 2 3").unwrap().0.as_bytes().to_vec();
        for value in [1.0f32, 2.0, 3.0, 4.0, 5.0, f32::NAN] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.push(3);
        for corner in [0i32, 1, 1] {
            bytes.extend(corner.to_le_bytes());
        }
        assert_eq!(parse("b.ply", &bytes, false).unwrap().points, expected);
        assert_eq!(parse_pcd("c.pcd", PCD.as_bytes()).unwrap().points, expected);
        for text in ["x y z\n1 2 3\n", "y x z\n2 1 3\n", "id,X,Y,Z\na,1,2,3\n", "\u{feff}1 2 3\n", "1 2 3 red\n"] {
            assert_eq!(
                parse_xyz("d.xyz", text.as_bytes()).unwrap(),
                CloudFile { points: expected.into(), normals: None }
            );
        }
    }

    #[test]
    fn normals_of_xyz_are_unit_vectors_or_named() {
        let of = |text: &str| parse_xyz("d.xyz", text.as_bytes()).unwrap().normals;
        let along_z = Some(vec![Vector3::z(); 2]);
        assert_eq!(of("1 2 3 0 0 1\nnan nan nan 0 0 0\n4 5 6 0 0 1\n"), along_z);
        assert_eq!(of("//x y z r nx ny nz\n1 2 3 7 0 0 2\n4 5 6 7 0 0 1\n"), along_z);
        assert_eq!(of("1 2 3 0 0 1\n4 5 6 0 0.5 1\n"), None, "a colour");
    }

    #[test]
    fn broken_files_are_named() {
        for (fault, expected) in [
            (parse("a.ply", b"solid", false), "a.ply: header"),
            (parse("a.ply", PLY.replace("1 2 3", "1 b 3").as_bytes(), false), "line 10: found `b`, expected a number"),
            (parse("a.ply", PLY.replace("1 2 3", "1 2 3 4").as_bytes(), false), "rows of face: found 0"),
            (parse("a.ply", PLY.replace("1 2 3", "1 2 1e300").as_bytes(), false), "point 1: found 1e300"),
            (
                parse("a.ply", (NO_FACES.to_owned() + "7 8 9\n").as_bytes(), false),
                "line 9: found `7`, expected no more",
            ),
            (parse_pcd("c.pcd", PCD.replace("TYPE F F F", "TYPE F Q F").as_bytes()), "TYPE: found Q of 4 bytes"),
            (parse_pcd("c.pcd", PCD.replace("COUNT 1 1 1", "COUNT 1 -1 1").as_bytes()), "COUNT: found -1"),
            (parse_pcd("c.pcd", PCD.replace("POINTS 2", "POINTS two").as_bytes()), "POINTS: found two"),
            (
                parse_pcd("c.pcd", PCD.replace("WIDTH 2", "WIDTH 1").as_bytes()),
                "POINTS: found 2, expected WIDTH · HEIGHT",
            ),
            (parse_xyz("d.xyz", b"a b c\n1 2 3\n"), "line 1: found columns a b c"),
            (parse("a.ply", PLY.replace("vertex 2", "vertex 9").as_bytes(), false), "rows of vertex: found 3"),
            (
                parse("a.ply", NO_FACES.replace("vertex 1", "vertex 9").as_bytes(), false),
                "rows of vertex: found 1, expected the 9 of the header",
            ),
            (parse_pcd("c.pcd", b"DATA binary_compressed\n"), "POINTS"),
            (parse_xyz("d.xyz", b"1 2 3\n1 2\n"), "line 2"),
            (parse_xyz("d.xyz", b"x y z\nd e f\n"), "line 2: found `d e f`"),
            (parse_xyz("d.xyz", b"1 2 3\n1 2 3 4\n"), "line 2: found 4 columns, expected the 3 of the first row"),
        ] {
            let fault = fault.unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
