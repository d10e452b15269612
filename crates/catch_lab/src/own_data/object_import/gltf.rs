//! Reads the triangles of glTF 2.0 files (`.gltf` and `.glb`), placed by the nodes of their scene.
//!
//! Lengths are in metres and y points up, as the format says; what is read has z up, as descriptions of robots mean such files.

use base64::{Engine, prelude::BASE64_STANDARD};
use catch_body::{InputError, TriangleMesh};
use nalgebra::{Matrix4, Point3, Quaternion, UnitQuaternion, Vector3};
use serde::Deserialize;

/// Nodes may be nested this deep.
const DEEPEST: usize = 64;
/// Nodes of a scene, instances counted each time.
const MOST_VISITS: usize = 10_000;
/// Triangles of all instances together.
const MOST_TRIANGLES: usize = 8_000_000;
/// Vertices of a primitive.
const MOST_VERTICES: usize = 24_000_000;
/// Content of GLB files: its first bytes, and the kinds of its parts.
const MAGIC: &[u8] = b"glTF";
const JSON: &[u8] = b"JSON";
const BINARY: &[u8] = b"BIN\0";

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Document {
    #[serde(default)]
    scene: usize,
    #[serde(default)]
    scenes: Vec<Scene>,
    #[serde(default)]
    nodes: Vec<Node>,
    #[serde(default)]
    meshes: Vec<Mesh>,
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<BufferView>,
    #[serde(default)]
    buffers: Vec<Buffer>,
    #[serde(default)]
    extensions_required: Vec<String>,
}

#[derive(Deserialize)]
struct Scene {
    #[serde(default)]
    nodes: Vec<usize>,
}

#[derive(Deserialize)]
struct Node {
    mesh: Option<usize>,
    #[serde(default)]
    children: Vec<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: Attributes,
    indices: Option<usize>,
    mode: Option<u32>,
}

#[derive(Deserialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    kind: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

#[derive(Deserialize)]
struct Buffer {
    uri: Option<String>,
}

/// Reads the bytes of a file; `file` names it in errors, and `load` reads what lies beside it.
///
/// # Errors
/// If it is no glTF 2.0, is compressed, refers to what is not there, or has no triangle.
pub fn read(
    file: &str,
    bytes: &[u8],
    load: &dyn Fn(&str) -> Result<Vec<u8>, InputError>,
) -> Result<TriangleMesh, InputError> {
    let fault = |field: &str, found: &str, expected: &str| InputError::new(file, field, found, expected);
    let (json, binary) = if bytes.starts_with(MAGIC) {
        let json = chunk(bytes, JSON).ok_or_else(|| fault("content", "no JSON chunk", "a GLB file of version 2"))?;
        (json, chunk(bytes, BINARY))
    } else {
        (bytes, None)
    };
    let document: Document =
        serde_json::from_slice(json).map_err(|it| fault("content", &it.to_string(), "a glTF 2.0 document"))?;
    // Extensions of materials and textures change no shape.
    let reshaping = ["draco", "meshopt", "quantization"];
    if let Some(name) = document.extensions_required.iter().find(|it| reshaping.iter().any(|word| it.contains(word))) {
        let expected = "a file without it: `gltf-transform copy` or Blender's export without compression writes one";
        return Err(fault("extensionsRequired", name, expected));
    }
    let buffers = document.buffers.iter().map(|buffer| match &buffer.uri {
        None => Ok(binary.unwrap_or_default().to_vec()),
        Some(uri) => match uri.strip_prefix("data:").and_then(|it| it.split_once(";base64,")) {
            Some((_, text)) => {
                BASE64_STANDARD.decode(text).map_err(|it| fault("buffers", &it.to_string(), "data in base64"))
            }
            None => load(&unescaped(uri)),
        },
    });
    let buffers = buffers.collect::<Result<Vec<_>, _>>()?;
    let mut reader = Reader { document: &document, buffers, mesh: TriangleMesh::default(), visits: 0 };
    let y_up = Matrix4::new_rotation(Vector3::x() * std::f64::consts::FRAC_PI_2);
    let roots = document.scenes.get(document.scene).map(|it| it.nodes.clone());
    // Without a scene all that is there is shown.
    let roots = roots.unwrap_or_else(|| (0..document.nodes.len()).collect());
    let placed = roots.into_iter().try_for_each(|root| reader.node(root, &y_up, 0));
    placed.map_err(|found| fault("content", &found, "triangles in buffers, as glTF 2.0 has them"))?;
    let mesh = reader.mesh;
    if mesh.triangles.is_empty() { Err(fault("meshes", "no triangles", "a surface")) } else { Ok(mesh) }
}

/// A part of a GLB file.
fn chunk<'a>(bytes: &'a [u8], kind: &[u8]) -> Option<&'a [u8]> {
    let mut rest = bytes.get(12..)?;
    while let Some((head, content)) = rest.split_at_checked(8) {
        let length = u32::from_le_bytes(head[..4].try_into().ok()?) as usize;
        let (content, behind) = content.split_at_checked(length)?;
        if &head[4..] == kind {
            return Some(content);
        }
        rest = behind;
    }
    None
}

/// A relative path whose `%20` and the like are bytes again.
fn unescaped(uri: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = uri.as_bytes();
    while let Some((first, behind)) = rest.split_first() {
        let code = || u8::from_str_radix(std::str::from_utf8(behind.get(..2)?).ok()?, 16).ok();
        (rest, _) = match (first, code()) {
            (b'%', Some(byte)) => (&behind[2..], bytes.push(byte)),
            _ => (behind, bytes.push(*first)),
        };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

struct Reader<'a> {
    document: &'a Document,
    buffers: Vec<Vec<u8>>,
    mesh: TriangleMesh,
    visits: usize,
}

impl Reader<'_> {
    fn node(&mut self, index: usize, X_WP: &Matrix4<f64>, depth: usize) -> Result<(), String> {
        self.visits += 1;
        if depth > DEEPEST || self.visits > MOST_VISITS {
            return Err("nodes without end".into());
        }
        let node = self.document.nodes.get(index).ok_or_else(|| format!("node {index}, which is not there"))?;
        let X_PN = node.matrix.map_or_else(
            || {
                let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
                let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9).unwrap_or_default();
                let scale = Vector3::from(node.scale.unwrap_or([1.0; 3]));
                let offset = Vector3::from(node.translation.unwrap_or_default());
                Matrix4::new_translation(&offset) * rotation.to_homogeneous() * Matrix4::new_nonuniform_scaling(&scale)
            },
            |columns| Matrix4::from_column_slice(&columns),
        );
        let X_WN = X_WP * X_PN;
        if let Some(mesh) = node.mesh {
            let mesh = self.document.meshes.get(mesh).ok_or_else(|| format!("mesh {mesh}, which is not there"))?;
            mesh.primitives.iter().try_for_each(|it| self.primitive(it, &X_WN))?;
        }
        node.children.iter().try_for_each(|child| self.node(*child, &X_WN, depth + 1))
    }

    fn primitive(&mut self, primitive: &Primitive, X_WN: &Matrix4<f64>) -> Result<(), String> {
        let Some(position) = primitive.attributes.position else { return Ok(()) };
        let vertices = self.rows(position, "VEC3")?;
        let vertices: Vec<Point3<f64>> =
            vertices.as_chunks::<3>().0.iter().map(|it| X_WN.transform_point(&Point3::from(*it))).collect();
        if vertices.iter().any(|it| !it.coords.iter().all(|value| value.is_finite())) {
            return Err("a vertex that is not finite".into());
        }
        let corners: Vec<u32> = match primitive.indices {
            Some(indices) => self.rows(indices, "SCALAR")?.into_iter().map(|it| it as u32).collect(),
            None => (0..vertices.len() as u32).collect(),
        };
        if let Some(missing) = corners.iter().find(|it| **it as usize >= vertices.len()) {
            return Err(format!("vertex {missing} of {}", vertices.len()));
        }
        let triangles: Vec<[u32; 3]> = match primitive.mode.unwrap_or(4) {
            4 => corners.as_chunks::<3>().0.to_vec(),
            5 => {
                let strip = corners.windows(3).enumerate();
                strip.map(|(i, it)| if i % 2 == 0 { [it[0], it[1], it[2]] } else { [it[1], it[0], it[2]] }).collect()
            }
            6 => corners.windows(2).skip(1).map(|it| [corners[0], it[0], it[1]]).collect(),
            _ => return Ok(()),
        };
        if self.mesh.triangles.len() + triangles.len() > MOST_TRIANGLES {
            return Err(format!("more than {MOST_TRIANGLES} triangles"));
        }
        self.mesh.merge(&TriangleMesh { vertices, triangles });
        Ok(())
    }

    /// The numbers of an accessor, row by row.
    fn rows(&self, accessor: usize, kind: &str) -> Result<Vec<f64>, String> {
        let missing = || format!("accessor {accessor}, which is not there or has no data");
        let accessor = self.document.accessors.get(accessor).ok_or_else(missing)?;
        let view = accessor.buffer_view.and_then(|it| self.document.buffer_views.get(it)).ok_or_else(missing)?;
        let buffer = self.buffers.get(view.buffer).ok_or_else(missing)?;
        let view_bytes =
            view.byte_offset.checked_add(view.byte_length).and_then(|end| buffer.get(view.byte_offset..end));
        let bytes = view_bytes.and_then(|it| it.get(accessor.byte_offset..));
        let bytes = bytes.ok_or("a buffer that ends early")?;
        let (columns, width) = match (kind, accessor.component_type) {
            ("VEC3", 5126) => (3, 4),
            ("SCALAR", 5121) => (1, 1),
            ("SCALAR", 5123) => (1, 2),
            ("SCALAR", 5125) => (1, 4),
            (_, other) => return Err(format!("{kind} numbers of type {other}")),
        };
        if accessor.kind != kind || accessor.count > MOST_VERTICES {
            return Err(format!("{} rows of {}", accessor.count, accessor.kind));
        }
        let stride = view.byte_stride.filter(|it| *it > 0).unwrap_or(columns * width);
        let mut numbers = Vec::with_capacity(accessor.count.min(bytes.len()) * columns);
        for row in 0..accessor.count {
            let start = row.saturating_mul(stride);
            let row = bytes.get(start..).and_then(|it| it.get(..columns * width)).ok_or("a buffer that ends early")?;
            numbers.extend(row.chunks_exact(width).map(|it| match *it {
                [a, b, c, d] if kind == "VEC3" => f64::from(f32::from_le_bytes([a, b, c, d])),
                [a, b, c, d] => f64::from(u32::from_le_bytes([a, b, c, d])),
                [a, b] => f64::from(u16::from_le_bytes([a, b])),
                _ => f64::from(it[0]),
            }));
        }
        Ok(numbers)
    }
}
