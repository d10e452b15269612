//! Reads the triangles of glTF 2.0 files (`.gltf` and `.glb`), placed by the nodes of their scene.
//!
//! Lengths are in metres and y points up, as the format says; what is read has z up, as descriptions of
//! robots mean such files.

use std::{
    borrow::Cow,
    collections::{HashMap, HashSet},
};

use base64::{Engine, prelude::BASE64_STANDARD};
use catch_body::{
    InputError, TriangleMesh,
    document::{Harmless, Node},
};
use nalgebra::{Matrix4, Quaternion, UnitQuaternion, Vector3};
use percent_encoding::percent_decode_str;

use super::{
    NUMBER, Scene,
    gltf_accessor::{Buffers, index, rows},
    ply::{fan, strip},
};
use crate::json;

/// Content of GLB files: its first bytes, and the kinds of its parts.
const MAGIC: &[u8] = b"glTF";
const JSON: &[u8] = b"JSON";
const BINARY: &[u8] = b"BIN\0";
/// Names that draw, move or describe a mesh.
const HARMLESS: Harmless = &[
    ("", "asset materials textures images samplers cameras animations extensionsUsed extensions"),
    ("nodes", "camera"),
    ("primitives", "material"),
    ("attributes", "NORMAL TANGENT TEXCOORD_0 TEXCOORD_1 TEXCOORD_2 TEXCOORD_3 COLOR_0 COLOR_1"),
    ("accessors", "min max normalized"),
    ("bufferViews", "target"),
    ("extensions", "KHR_materials_variants KHR_lights_punctual MSFT_lod KHR_node_visibility"),
    ("*", "name extras"),
];
/// An extension by which a node, with all below it, may be hidden.
const VISIBILITY: &str = "KHR_node_visibility";
/// Required extensions that are read, or that are of materials, textures and lights.
const MAY_BE_REQUIRED: [&str; 6] =
    [VISIBILITY, "KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "ADOBE_materials_"];

/// Reads the bytes of a file; `file` names it in errors, and `load` reads what lies beside it.
///
/// # Errors
/// If it is no glTF 2.0, has what changes its shape and is not read, or refers to what is not there.
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
    let document = json::document(file, json)?;
    let root = document.root();
    for name in root.child("extensionsRequired").into_iter().flat_map(Node::items) {
        if !MAY_BE_REQUIRED.iter().any(|it| name.text().starts_with(it)) {
            let expected =
                "a file without it: `gltf-transform copy` or Blender's export without compression writes one";
            return Err(fault("extensionsRequired", name.text(), expected));
        }
    }
    let list = |name| root.child(name).into_iter().flat_map(Node::items).collect::<Vec<_>>();
    let buffers = list("buffers").into_iter().map(|it| bytes_of(it, binary, load)).collect::<Result<_, _>>()?;
    let buffers = Buffers { views: list("bufferViews"), accessors: list("accessors"), buffers };
    let mut reader = Reader {
        file,
        nodes: list("nodes"),
        shown: HashSet::new(),
        meshes: list("meshes"),
        buffers,
        known: HashMap::new(),
        scene: Scene::default(),
    };
    let y_up = Matrix4::new_rotation(Vector3::x() * std::f64::consts::FRAC_PI_2);
    for node in reader.roots(root)? {
        reader.node(node, &y_up, 0)?;
    }
    reader.leave_out_the_rest();
    document.finish(&[HARMLESS])?;
    Ok(reader.scene.shown)
}

/// The bytes of a buffer: of the file itself, within the document, or of a file beside it.
fn bytes_of<'a>(
    buffer: Node,
    binary: Option<&'a [u8]>,
    load: &dyn Fn(&str) -> Result<Vec<u8>, InputError>,
) -> Result<Cow<'a, [u8]>, InputError> {
    let length = buffer.child("byteLength").map(index).transpose()?;
    let bytes: Cow<[u8]> = match buffer.child("uri") {
        None => Cow::Borrowed(binary.unwrap_or_default()),
        Some(uri) => match uri.text().strip_prefix("data:").map(|data| data.split_once(";base64,")) {
            Some(Some((_, text))) => BASE64_STANDARD.decode(text).map_err(|it| uri.fault(it, "data in base64"))?.into(),
            Some(None) => return Err(uri.fault("data of another kind", "data:…;base64,…")),
            None => load(&percent_decode_str(uri.text()).decode_utf8_lossy())?.into(),
        },
    };
    if length.is_some_and(|it| it > bytes.len()) {
        return Err(buffer.fault(format!("{} bytes", bytes.len()), "as many as its byteLength says"));
    }
    Ok(bytes)
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

struct Reader<'a> {
    file: &'a str,
    nodes: Vec<Node<'a>>,
    /// Numbers of the nodes that are shown.
    shown: HashSet<usize>,
    meshes: Vec<Node<'a>>,
    buffers: Buffers<'a>,
    /// Primitives that were read, by mesh and primitive.
    known: HashMap<(usize, usize), TriangleMesh>,
    scene: Scene,
}

impl<'a> Reader<'a> {
    /// The nodes of the scene that is shown; of a file without scenes all nodes that are in no other.
    fn roots(&self, root: Node<'a>) -> Result<Vec<usize>, InputError> {
        let scenes: Vec<Node> = root.child("scenes").into_iter().flat_map(Node::items).collect();
        let shown = root.child("scene").map(index).transpose()?;
        if let Some(missing) = shown.filter(|it| *it >= scenes.len()) {
            let found = format!("scene {missing} of {}", scenes.len());
            return Err(InputError::new(self.file, "scene", found, "a scene that is there"));
        }
        if scenes.len() > 1 && shown.is_none() {
            let found = format!("{} scenes, and none that is shown", scenes.len());
            return Err(InputError::new(self.file, "scene", found, "the number of one of them"));
        }
        for (i, scene) in scenes.iter().enumerate() {
            if i != shown.unwrap_or(0) {
                scene.leave_out();
            }
        }
        let indices = |of: Node<'a>, name| of.child(name).into_iter().flat_map(Node::items).map(index).collect();
        if let Some(scene) = scenes.get(shown.unwrap_or(0)) {
            return indices(*scene, "nodes");
        }
        let mut is_child = vec![false; self.nodes.len()];
        for node in &self.nodes {
            let children: Vec<usize> = indices(*node, "children")?;
            children.iter().filter(|it| **it < self.nodes.len()).for_each(|it| is_child[*it] = true);
        }
        let roots: Vec<usize> = (0..self.nodes.len()).filter(|it| !is_child[*it]).collect();
        if roots.is_empty() && !self.nodes.is_empty() {
            return Err(InputError::new(self.file, "nodes", "nodes without end", "a node that is in no other"));
        }
        Ok(roots)
    }

    fn node(&mut self, number: usize, X_WP: &Matrix4<f64>, depth: usize) -> Result<(), InputError> {
        let fault = |found: String, expected: &str| InputError::new(self.file, "nodes", found, expected);
        let node = *self.nodes.get(number).ok_or_else(|| fault(format!("node {number}"), "a node that is there"))?;
        self.scene.visit(node, depth)?;
        let visibility = node.child("extensions").and_then(|it| it.child(VISIBILITY));
        if visibility.and_then(|it| it.child("visible")).is_some_and(|it| it.text() == "false") {
            return Ok(());
        }
        self.shown.insert(number);
        let X_PN = match node.child("matrix") {
            Some(stated) => {
                let matrix = Matrix4::from_column_slice(&stated.numbers::<16>(NUMBER)?);
                if matrix.row(3) != Matrix4::identity().row(3) {
                    let found = format!("a last row of {:?}", matrix.row(3).iter().collect::<Vec<_>>());
                    return Err(stated.fault(found, "0, 0, 0, 1, as of rotation, scale and translation"));
                }
                matrix
            }
            None => {
                let of = |name, or| node.child(name).map_or(Ok(or), |it| it.numbers::<3>(NUMBER)).map(Vector3::from);
                let rotation = node.child("rotation").map(|it| it.numbers::<4>(NUMBER)).transpose()?;
                let [x, y, z, w] = rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
                let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9).unwrap_or_default();
                let (offset, scale) = (of("translation", [0.0; 3])?, of("scale", [1.0; 3])?);
                Matrix4::new_translation(&offset) * rotation.to_homogeneous() * Matrix4::new_nonuniform_scaling(&scale)
            }
        };
        let X_WN = X_WP * X_PN;
        if let Some(number) = node.child("mesh").map(index).transpose()? {
            let missing = || fault(format!("mesh {number}"), "a mesh that is there");
            let mesh = *self.meshes.get(number).ok_or_else(missing)?;
            passed_over(mesh);
            let primitives = mesh.child("primitives").into_iter().flat_map(Node::items);
            for (i, primitive) in primitives.enumerate() {
                if !self.known.contains_key(&(number, i)) {
                    let surface = self.primitive(primitive)?;
                    self.known.insert((number, i), surface);
                }
                self.scene.add(&self.known[&(number, i)], &X_WN, primitive)?;
            }
        }
        for child in node.child("children").into_iter().flat_map(Node::items) {
            self.node(index(child)?, &X_WN, depth + 1)?;
        }
        Ok(())
    }

    /// The triangles of a primitive with the vertices that they have.
    fn primitive(&self, primitive: Node<'a>) -> Result<TriangleMesh, InputError> {
        passed_over(primitive);
        let mode = primitive.child("mode").map(index).transpose()?.unwrap_or(4);
        let attributes = primitive.child("attributes");
        // Names of one's own begin so, as the format says.
        let own = attributes.into_iter().flat_map(Node::elements).filter(|it| it.name().starts_with('_'));
        own.for_each(Node::leave_out);
        let position = attributes.and_then(|it| it.child("POSITION"));
        let Some(position) = position.filter(|_| (4..=6).contains(&mode)) else {
            // Points and lines are no surface.
            primitive.leave_out();
            return Ok(TriangleMesh::default());
        };
        let places = rows(&self.buffers, position, "VEC3")?;
        let corners: Vec<u32> = match primitive.child("indices") {
            Some(indices) => rows(&self.buffers, indices, "SCALAR")?.into_iter().map(|it| it as u32).collect(),
            None => (0..(places.len() / 3) as u32).collect(),
        };
        if let Some(missing) = corners.iter().find(|it| **it as usize >= places.len() / 3) {
            return Err(primitive.fault(format!("vertex {missing} of {}", places.len() / 3), "a vertex that is there"));
        }
        let triangles = match mode {
            4 => corners.as_chunks::<3>().0.to_vec(),
            5 => strip(&corners).collect(),
            _ => fan(&corners).collect(),
        };
        let vertices = places.as_chunks().0.iter().map(|it| <[f64; 3]>::into(*it)).collect();
        let mut mesh = TriangleMesh { vertices, triangles };
        mesh.drop_unused_vertices();
        Ok(mesh)
    }

    /// Marks what the scene does not show as not used.
    fn leave_out_the_rest(&self) {
        let shown: Vec<usize> = self.known.keys().map(|it| it.0).collect();
        for (i, mesh) in self.meshes.iter().enumerate() {
            if !shown.contains(&i) {
                mesh.leave_out();
            }
        }
        let unseen = self.nodes.iter().enumerate().filter(|(i, _)| !self.shown.contains(i));
        unseen.for_each(|(_, node)| node.leave_out());
        self.buffers.leave_out_unused();
    }
}

/// Extensions are asked for, so that each of them is harmless or a fault.
fn passed_over(node: Node) {
    node.child("extensions");
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle with corners at 0, x and y, and normals.
    fn document(edit: impl Fn(&str) -> String) -> Result<TriangleMesh, InputError> {
        let mut bytes = Vec::new();
        for value in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0] {
            bytes.extend(value.to_le_bytes());
        }
        let text = format!(
            r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
            "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0, "NORMAL": 1}}}}]}}],
            "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "max": [1, 1, 1]}},
              {{"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3"}}],
            "bufferViews": [{{"buffer": 0, "byteLength": 36}}, {{"buffer": 0, "byteOffset": 36, "byteLength": 36}}],
            "buffers": [{{"byteLength": 72, "uri": "data:;base64,{}"}}]}}"#,
            BASE64_STANDARD.encode(bytes)
        );
        read("a.gltf", edit(&text).as_bytes(), &|_| unreachable!())
    }

    /// Corners in the format's own axes.
    fn corners(edit: impl Fn(&str) -> String) -> Vec<[f64; 3]> {
        let mesh = document(edit).unwrap();
        mesh.vertices.iter().map(|it| [it.x, it.z, -it.y].map(|value| (value * 1e6).round() / 1e6 + 0.0)).collect()
    }

    #[test]
    fn vertices_are_read_but_nothing_that_would_move_them() {
        let plain = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(corners(str::to_owned), plain);
        for (after, name, value) in [
            ("\"NORMAL\": 1}", "targets", "[{\"POSITION\": 1}]"),
            ("\"count\": 3", "sparse", "{\"count\": 1}"),
            ("{\"mesh\": 0", "weights", "[2]"),
        ] {
            let more = format!("{after}, \"{name}\": {value}");
            let fault = document(|it| it.replacen(after, &more, 1)).unwrap_err().to_string();
            assert!(fault.contains(&format!("found `{name}`, which is not read")), "{fault}");
        }
    }

    #[test]
    fn unknown_keys_of_what_is_used_are_refused() {
        let accessor = |it: &str| it.replacen("\"count\": 3", "\"count\": 3, \"stretch\": 2", 1);
        let view = |it: &str| {
            it.replacen("{\"buffer\": 0, \"byteLength\"", "{\"buffer\": 0, \"stretch\": 2, \"byteLength\"", 1)
        };
        for fault in [document(accessor), document(view)] {
            assert!(fault.unwrap_err().to_string().contains("stretch"));
        }
        // The normals are not read.
        let unused = |it: &str| it.replace("{\"bufferView\": 1", "{\"stretch\": 2, \"bufferView\": 1");
        assert_eq!(corners(unused).len(), 3);
    }

    #[test]
    fn data_of_another_kind_are_no_name_of_a_file() {
        let fault = document(|it| it.replace(";base64,", ";base32,")).unwrap_err().to_string();
        assert!(fault.contains("uri") && fault.contains(";base64,") && fault.len() < 200, "{fault}");
    }

    #[test]
    fn without_a_scene_each_node_is_shown_once() {
        let nodes = "\"nodes\": [{\"children\": [1], \"scale\": [2, 2, 2]}, {\"mesh\": 0}]";
        let without = |it: &str| {
            it.replace("\"scene\": 0, \"scenes\": [{\"nodes\": [0]}], ", "")
                .replace("\"nodes\": [{\"mesh\": 0}]", nodes)
        };
        assert_eq!(corners(without), [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]);
    }

    #[test]
    fn what_is_not_shown_is_not_looked_at() {
        let more = |it: &str| {
            it.replace(
                "\"nodes\": [{\"mesh\": 0}]",
                "\"nodes\": [{\"mesh\": 0, \"extensions\": {\"KHR_lights_punctual\": {}}}, {\"mesh\": 1, \"skin\": 2}]",
            )
            .replace("\"NORMAL\": 1}", "\"NORMAL\": 1, \"_BATCHID\": 1}")
        };
        assert_eq!(corners(more).len(), 3);
        let hidden =
            r#"{"mesh": 0, "children": [1], "extensions": {"KHR_node_visibility": {"visible": false}}}, {"mesh": 0}"#;
        let shown = |more: &'static str| {
            document(move |it: &str| {
                let nodes = format!("\"nodes\": [{hidden}{more}]");
                let required = "\"extensionsRequired\": [\"KHR_node_visibility\"], \"scene\": 0";
                it.replace("\"nodes\": [{\"mesh\": 0}]", &nodes)
                    .replace("[0]", "[0, 2]")
                    .replace("\"scene\": 0", required)
            })
        };
        let one = shown(", {\"mesh\": 0, \"extensions\": {\"KHR_node_visibility\": {\"visible\": true}}}");
        assert_eq!(one.unwrap().vertices.len(), 3);
        assert!(shown(", {\"name\": \"nothing\"}").unwrap().triangles.is_empty());
    }

    #[test]
    fn what_is_not_read_is_refused() {
        for (from, to, expected) in [
            (
                "{\"mesh\": 0}",
                "{\"mesh\": 0, \"extensions\": {\"EXT_mesh_gpu_instancing\": {}}}",
                "EXT_mesh_gpu_instancing",
            ),
            ("{\"mesh\": 0}", "{\"mesh\": 0, \"skin\": 0}", "nodes[0].skin: found `skin`"),
            (
                "{\"mesh\": 0}",
                "{\"mesh\": 0, \"matrix\": [1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}",
                "nodes[0].matrix: found a last row of [5.0, 0.0, 0.0, 1.0]",
            ),
            (
                "\"scene\": 0,",
                "\"extensionsRequired\": [\"XY_new\"], \"scene\": 0,",
                "extensionsRequired: found XY_new",
            ),
            ("\"scene\": 0,", "\"scene\": 3,", "scene 3 of 1"),
            ("\"NORMAL\": 1}", "\"NORMAL\": 1, \"JOINTS_0\": 1}", "JOINTS_0"),
            ("\"byteLength\": 72", "\"byteLength\": 73", "72 bytes"),
        ] {
            let fault = document(|it| it.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
