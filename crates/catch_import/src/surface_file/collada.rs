//! Reads the triangles of COLLADA files, as descriptions of robots use them for surfaces.
//!
//! Geometries are placed by the nodes of the scene, in the file's unit; materials, animations and what the
//! scene does not show are left aside.

use std::collections::HashMap;

use nalgebra::{Matrix4, Point3, Rotation3, Unit, Vector3};

use super::{
    NUMBER, Scene,
    ply::{fan, strip},
};
use catch_body::{
    InputError, TriangleMesh,
    document::{Document, Harmless, Node},
    mesh_file::MOST_TRIANGLES,
    quantity::Quantity,
};

/// Kind of file that is expected.
const EXPECTED: &str = "a COLLADA mesh of triangles or polygons";
/// Metres per unit.
const METRES: Quantity = Quantity { least: 1e-9, most: 1e9, unit: "m" };

/// Names that draw, move or describe a mesh. Its upward axis changes nothing: descriptions of robots mean the
/// coordinates as they stand.
const HARMLESS: Harmless = &[
    (
        "COLLADA",
        "@version @base library_animations library_animation_clips library_cameras library_controllers \
         library_effects library_force_fields library_images library_lights library_materials \
         library_physics_materials library_physics_models library_physics_scenes library_kinematics_models \
         library_kinematics_scenes library_joints library_articulated_systems library_formulas",
    ),
    ("asset", "contributor created keywords modified revision subject title up_axis coverage"),
    ("unit", "@name"),
    ("scene", "instance_physics_scene instance_kinematics_scene"),
    ("visual_scene", "evaluate_scene"),
    ("node", "@type @layer instance_camera instance_light"),
    ("instance_geometry", "bind_material"),
    ("mesh", "lines linestrips"),
    ("source", "technique Name_array bool_array IDREF_array"),
    ("float_array", "@digits @magnitude"),
    ("accessor", "@source"),
    ("param", "@type"),
    ("input", "@semantic @source @set"),
    ("*", "extra asset @id @sid @name @count @material @xsi:schemaLocation"),
];

/// Vertices in metres and triangles of all geometries of a file.
pub(super) fn read(file: &str, bytes: &[u8]) -> Result<TriangleMesh, InputError> {
    let fault = |found: String| InputError::new(file, "content", found, EXPECTED);
    let text = std::str::from_utf8(bytes).map_err(|it| fault(it.to_string()))?;
    let document = Document::from_xml(file, text.trim_start_matches('\u{feff}'), EXPECTED)?;
    let root = document.root();
    if root.name() != "COLLADA" {
        return Err(fault(format!("<{}>", root.name())));
    }
    let by_id = root.descendants().filter_map(|node| Some((node.attribute("id")?, node))).collect();
    let mut reader = Reader { by_id, known: HashMap::new(), scene: Scene::default() };
    let unit = root.child("asset").and_then(|it| it.child("unit")).filter(|it| it.has("meter"));
    let metres = unit.map_or(Ok(1.0), |it| it.number_of("meter", METRES))?;
    let libraries: Vec<Node> = root.children("library_visual_scenes").collect();
    let scenes: Vec<Node> = libraries.iter().flat_map(|it| it.children("visual_scene")).collect();
    let shown = root.child("scene").and_then(|it| it.child("instance_visual_scene"));
    let shown = shown.map(|it| reader.target(it, "url")).transpose()?;
    for scene in scenes {
        if shown.is_some_and(|it| it.attribute("id") != scene.attribute("id")) {
            scene.leave_out();
            continue;
        }
        for node in scene.children("node") {
            reader.node(node, &Matrix4::new_scaling(metres), 0)?;
        }
    }
    // Geometry that no scene shows is not looked at.
    for library in root.children("library_geometries").chain(root.children("library_nodes")) {
        library.children("geometry").chain(library.children("node")).for_each(|it| reader.leave_out_unless_used(it));
    }
    document.finish(&[HARMLESS])?;
    Ok(reader.scene.shown)
}

struct Reader<'a> {
    by_id: HashMap<&'a str, Node<'a>>,
    /// Geometries and nodes that were shown, by their ids; of geometries what they hold.
    known: HashMap<&'a str, TriangleMesh>,
    scene: Scene,
}

impl<'a> Reader<'a> {
    fn node(&mut self, node: Node<'a>, X_WP: &Matrix4<f64>, depth: usize) -> Result<(), InputError> {
        self.scene.visit(node, depth)?;
        if let Some(id) = node.attribute("id") {
            self.known.entry(id).or_default();
        }
        let mut X_WN = *X_WP;
        for it in node.elements() {
            X_WN *= transform(it)?;
        }
        for child in node.children("node") {
            self.node(child, &X_WN, depth + 1)?;
        }
        for instance in node.children("instance_node") {
            let target = self.target(instance, "url")?.read();
            self.node(target, &X_WN, depth + 1)?;
        }
        for instance in node.children("instance_geometry") {
            let geometry = self.target(instance, "url")?.read();
            self.place(geometry, &X_WN)?;
        }
        Ok(())
    }

    fn leave_out_unless_used(&self, node: Node<'a>) {
        if node.attribute("id").is_none_or(|it| !self.known.contains_key(it)) {
            node.leave_out();
        }
    }

    fn target(&self, node: Node<'a>, attribute: &'static str) -> Result<Node<'a>, InputError> {
        let named = node.attribute(attribute).unwrap_or_default();
        let found = named.strip_prefix('#').and_then(|it| self.by_id.get(it)).copied();
        found.ok_or_else(|| node.fault(format!("{attribute}=\"{named}\""), "the id of an element of this file"))
    }

    fn place(&mut self, geometry: Node<'a>, X_WG: &Matrix4<f64>) -> Result<(), InputError> {
        let id = geometry.attribute("id").unwrap_or_default();
        if !self.known.contains_key(id) {
            let surface = self.geometry(geometry)?;
            self.known.insert(id, surface);
        }
        self.scene.add(&self.known[id], X_WG, geometry)
    }

    /// Reads the triangles of a geometry, in its own frame; only vertices that some face has.
    fn geometry(&self, geometry: Node<'a>) -> Result<TriangleMesh, InputError> {
        let mut surface = TriangleMesh::default();
        let mut positions = HashMap::new();
        for mesh in geometry.children("mesh") {
            // Vertices are found by their id where they are used.
            mesh.children("vertices").flat_map(|it| it.children("input")).for_each(drop);
            let mut read = 0;
            for kind in ["triangles", "polylist", "polygons", "tristrips", "trifans"] {
                for primitive in mesh.children(kind) {
                    self.primitive(primitive, kind, &mut surface, &mut positions)?;
                    read += 1;
                }
            }
            for source in mesh.children("source") {
                // Normals, colours and places in textures have sources of their own.
                let is_used = source.attribute("id").is_some_and(|it| positions.contains_key(it));
                if !is_used || read == 0 {
                    source.leave_out();
                }
            }
        }
        Ok(surface)
    }

    /// The source of the places of the vertices that an input means.
    fn positions_of(&self, vertex: Node<'a>) -> Result<Node<'a>, InputError> {
        let vertices = self.target(vertex, "source")?;
        let mut places = vertices.children("input").filter(|it| it.attribute("semantic") == Some("POSITION"));
        let places = places.next().ok_or_else(|| vertex.fault("vertices without positions", EXPECTED))?;
        self.target(places, "source")
    }

    fn primitive(
        &self,
        primitive: Node<'a>,
        kind: &'static str,
        surface: &mut TriangleMesh,
        positions: &mut HashMap<&'a str, Vec<Point3<f64>>>,
    ) -> Result<(), InputError> {
        let fault = |found: &str| primitive.fault(found, EXPECTED);
        let inputs: Vec<(Node, &str, usize)> = primitive.children("input").map(input_of).collect();
        let stride = inputs.iter().map(|it| it.2).max().unwrap_or(0).saturating_add(1);
        let vertex = inputs.iter().find(|it| it.1 == "VERTEX").ok_or_else(|| fault("faces without vertices"))?;
        let source = self.positions_of(vertex.0)?;
        let id = source.attribute("id").unwrap_or_default();
        if !positions.contains_key(id) {
            positions.insert(id, read_positions(source)?);
        }
        let places = &positions[id];
        let mut numbers = HashMap::new();
        let mut corner = |index: usize| -> Result<u32, InputError> {
            let place = *places.get(index).ok_or_else(|| fault("a vertex that is not there"))?;
            let vertices = &mut surface.vertices;
            Ok(*numbers.entry(index).or_insert_with(|| {
                vertices.push(place);
                vertices.len() as u32 - 1
            }))
        };
        let counts = primitive.child("vcount").map(numbers_of::<usize>).transpose()?;
        let mut counts = counts.unwrap_or_default().into_iter();
        for list in primitive.children("p") {
            let all = numbers_of::<usize>(list)?;
            let corners: Vec<usize> = all.iter().skip(vertex.2).step_by(stride).copied().collect();
            let corners: Vec<u32> = corners.into_iter().map(&mut corner).collect::<Result<_, _>>()?;
            let triangles = &mut surface.triangles;
            match kind {
                "tristrips" => triangles.extend(strip(&corners)),
                "polygons" | "trifans" => triangles.extend(fan(&corners)),
                "triangles" => triangles.extend(corners.as_chunks::<3>().0),
                _ => {
                    let mut rest = &corners[..];
                    for size in counts.by_ref() {
                        let (face, others) =
                            rest.split_at_checked(size).ok_or_else(|| fault("fewer corners than faces need"))?;
                        rest = others;
                        triangles.extend(fan(face));
                    }
                }
            }
            if triangles.len() > MOST_TRIANGLES {
                return Err(fault("more triangles than are read"));
            }
        }
        Ok(())
    }
}

/// An input of a primitive, its semantic, and its offset among the numbers of a corner.
fn input_of(node: Node<'_>) -> (Node<'_>, &str, usize) {
    let offset = node.attribute("offset").and_then(|it| it.parse().ok()).unwrap_or(0);
    (node, node.attribute("semantic").unwrap_or_default(), offset)
}

/// The places of a source, as its accessor says.
fn read_positions(source: Node) -> Result<Vec<Point3<f64>>, InputError> {
    let missing = || source.fault("no <float_array>", "the places of vertices");
    let values = numbers_of::<f64>(source.child("float_array").ok_or_else(missing)?)?;
    let accessor = source.child("technique_common").and_then(|it| it.child("accessor"));
    let number = |name: &'static str, or: usize| accessor.and_then(|it| it.attribute(name)?.parse().ok()).unwrap_or(or);
    let (stride, offset) = (number("stride", 3), number("offset", 0));
    let axes: Vec<&str> = accessor
        .into_iter()
        .flat_map(|it| it.children("param"))
        .map(|it| it.attribute("name").unwrap_or_default())
        .collect();
    if stride < 3 || !(axes.is_empty() || axes.iter().take(3).copied().eq(["X", "Y", "Z"])) {
        return Err(source.fault(format!("places {} with a stride of {stride}", axes.join(", ")), "X, Y, Z"));
    }
    let rows = values.get(offset..).unwrap_or_default().chunks(stride);
    Ok(rows.filter_map(|it| Some(Point3::new(*it.first()?, *it.get(1)?, *it.get(2)?))).collect())
}

/// Transformation of the frame of a node by an element; the identity for one that is no transformation.
fn transform(node: Node) -> Result<Matrix4<f64>, InputError> {
    Ok(match node.name() {
        "matrix" => Matrix4::from_row_slice(&node.read().numbers::<16>(NUMBER)?),
        "translate" => Matrix4::new_translation(&node.read().numbers::<3>(NUMBER)?.into()),
        "scale" => Matrix4::new_nonuniform_scaling(&node.read().numbers::<3>(NUMBER)?.into()),
        "rotate" => {
            let [x, y, z, degrees] = node.read().numbers(NUMBER)?;
            let axis = Unit::try_new(Vector3::new(x, y, z), 1e-9);
            axis.map_or_else(Matrix4::identity, |axis| {
                Rotation3::from_axis_angle(&axis, degrees.to_radians()).to_homogeneous()
            })
        }
        _ => Matrix4::identity(),
    })
}

fn numbers_of<T: std::str::FromStr>(node: Node) -> Result<Vec<T>, InputError> {
    let number = |word: &str| {
        let found = || node.fault(format!("`{}`", word.chars().take(40).collect::<String>()), "a number");
        word.parse().map_err(|_| found())
    };
    node.text().split_whitespace().map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: &str = r##"<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema">
      <asset><unit meter="0.001"/><up_axis>Y_UP</up_axis></asset>
      <library_geometries><geometry id="g"><mesh>
        <source id="s"><float_array id="f" count="12">0 0 0 1000 0 0 1000 1000 0 0 1000 0</float_array></source>
        <vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
        <polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>
          <vcount>4</vcount><p>0 0 1 0 2 0 3 0</p></polylist>
      </mesh></geometry></library_geometries>
      <library_visual_scenes><visual_scene id="w"><node><translate>0 0 500</translate>
        <instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
    </COLLADA>"##;

    #[test]
    fn polygons_are_placed_and_scaled() {
        let TriangleMesh { vertices, triangles } = read("a.dae", SQUARE.as_bytes()).unwrap();
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3]]);
        let expected = Vector3::new(1.0, 1.0, 0.5);
        assert!((vertices[2].coords - expected).norm() < 1e-12, "{:?}", vertices[2]);
    }

    #[test]
    fn faults_are_told() {
        for (from, to) in [
            ("<vcount>4</vcount>", "<vcount>5</vcount>"),
            ("0 0 1 0 2", "0 0 x 0 2"),
            ("COLLADA xmlns", "collada xmlns"),
            ("\"#v\"", "\"#none\""),
            ("<translate>0 0 500</translate>", "<skew>1 0 0 1 0 0 1</skew>"),
            ("url=\"#g\"", "url=\"#h\""),
            ("<vcount>4</vcount>", "<vcount>4</vcount><ph/>"),
            ("<mesh>", "<convex_mesh/><mesh>"),
        ] {
            let text = SQUARE
                .replace(from, to)
                .replace("</COLLADA>", if from.starts_with("COLL") { "</collada>" } else { "</COLLADA>" });
            assert!(read("a.dae", text.as_bytes()).is_err(), "{from}");
        }
    }

    /// A node that is its own instance ends.
    #[test]
    fn circles_of_nodes_end() {
        let text = SQUARE.replace("<node>", "<node id=\"a\"><instance_node url=\"#a\"/>");
        assert!(read("a.dae", text.as_bytes()).is_err());
    }

    #[test]
    fn strips_are_triangles_and_only_the_scene_is_shown() {
        let strips = SQUARE.replace("polylist", "tristrips").replace("<vcount>4</vcount>", "");
        assert_eq!(read("a.dae", strips.as_bytes()).unwrap().triangles, [[0, 1, 2], [2, 1, 3]]);
        let other = "<visual_scene id=\"x\"><node><skew/><instance_geometry url=\"#g\"/></node></visual_scene>";
        let text = SQUARE
            .replace("<library_visual_scenes>", &format!("<library_visual_scenes>{other}"))
            .replace("</COLLADA>", "<scene><instance_visual_scene url=\"#w\"/></scene></COLLADA>");
        assert_eq!(read("a.dae", text.as_bytes()).unwrap().triangles.len(), 2);
    }
}
