//! Reads the triangles of COLLADA files, as descriptions of robots use them for surfaces.
//!
//! Geometries are placed by the nodes of the scene, in the file's unit; materials, animations and all else are left aside.

use std::collections::HashMap;

use nalgebra::{Matrix4, Point3, Rotation3, Unit, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

use super::Soup;
use crate::InputError;

/// Elements and attributes of a file at most.
const MOST_NODES: u32 = 2_000_000;
/// Nodes of a scene may be nested this deep.
const DEEPEST: usize = 64;
/// Nodes of a scene, instances counted each time.
const MOST_VISITS: usize = 10_000;
/// Triangles of all instances together.
const MOST_TRIANGLES: usize = 4_000_000;

/// Vertices in metres and triangles of all geometries of a file.
pub(super) fn read(file: &str, bytes: &[u8]) -> Result<Soup, InputError> {
    let fault = |found: String| InputError::new(file, "content", found, "a COLLADA mesh of triangles or polygons");
    let text = std::str::from_utf8(bytes).map_err(|it| fault(it.to_string()))?;
    let options = ParsingOptions { nodes_limit: MOST_NODES, allow_dtd: false, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options).map_err(|it| fault(it.to_string()))?;
    let root = document.root_element();
    if root.tag_name().name() != "COLLADA" {
        return Err(fault(format!("<{}>", root.tag_name().name())));
    }
    let by_id: HashMap<&str, Node> =
        document.descendants().filter_map(|node| Some((node.attribute("id")?, node))).collect();
    let mut reader = Reader { by_id, soup: Soup::default(), visits: 0, broken: None };
    for scene in document.descendants().filter(|it| it.tag_name().name() == "visual_scene") {
        for node in elements(scene, "node") {
            reader.node(node, &in_metres(root), 0);
        }
    }
    match reader.broken {
        Some(broken) => Err(fault(broken)),
        None => Ok(reader.soup),
    }
}

/// From the file's unit to metres. Its upward axis changes nothing: descriptions of robots mean the coordinates as they stand.
fn in_metres(root: Node) -> Matrix4<f64> {
    let unit = elements(root, "asset").next().and_then(|it| elements(it, "unit").next());
    let metres = unit.and_then(|it| it.attribute("meter")?.parse::<f64>().ok());
    Matrix4::new_scaling(metres.filter(|it| it.is_finite() && *it > 0.0).unwrap_or(1.0))
}

struct Reader<'a> {
    by_id: HashMap<&'a str, Node<'a, 'a>>,
    soup: Soup,
    visits: usize,
    broken: Option<String>,
}

impl<'a> Reader<'a> {
    fn node(&mut self, node: Node<'a, 'a>, X_WP: &Matrix4<f64>, depth: usize) {
        self.visits += 1;
        if depth > DEEPEST || self.visits > MOST_VISITS {
            self.broken = Some(format!("nodes nested more than {DEEPEST} deep, or more than {MOST_VISITS} of them"));
            return;
        }
        let X_WN = node.children().filter(Node::is_element).fold(*X_WP, |pose, it| pose * transform(it));
        for child in node.children().filter(Node::is_element) {
            match child.tag_name().name() {
                "node" => self.node(child, &X_WN, depth + 1),
                "instance_node" => {
                    if let Some(target) = self.target(child, "url") {
                        self.node(target, &X_WN, depth + 1);
                    }
                }
                "instance_geometry" => {
                    if let Some(geometry) = self.target(child, "url") {
                        self.geometry(geometry, &X_WN);
                    }
                }
                _ => {}
            }
        }
    }

    fn target(&self, node: Node, attribute: &str) -> Option<Node<'a, 'a>> {
        self.by_id.get(node.attribute(attribute)?.strip_prefix('#')?).copied()
    }

    fn geometry(&mut self, geometry: Node<'a, 'a>, X_WG: &Matrix4<f64>) {
        let primitives = geometry.descendants().filter(|it| {
            matches!(it.tag_name().name(), "triangles" | "polylist" | "polygons" | "tristrips" | "trifans")
        });
        for primitive in primitives {
            if self.broken.is_some() {
                return;
            }
            if let Err(broken) = self.primitive(primitive, X_WG) {
                self.broken = Some(broken);
            }
        }
    }

    fn primitive(&mut self, primitive: Node<'a, 'a>, X_WG: &Matrix4<f64>) -> Result<(), String> {
        let kind = primitive.tag_name().name();
        if matches!(kind, "tristrips" | "trifans") {
            return Err(format!("<{kind}>"));
        }
        let inputs: Vec<Node> = elements(primitive, "input").collect();
        let offset = |input: &Node| input.attribute("offset").and_then(|it| it.parse::<usize>().ok()).unwrap_or(0);
        let stride = inputs.iter().map(offset).max().unwrap_or(0).saturating_add(1);
        let vertex =
            inputs.iter().find(|it| it.attribute("semantic") == Some("VERTEX")).ok_or("faces without vertices")?;
        let vertices = self.target(*vertex, "source").ok_or("vertices that are not there")?;
        let input = elements(vertices, "input").find(|it| it.attribute("semantic") == Some("POSITION"));
        let source = input.and_then(|it| self.target(it, "source")).ok_or("positions that are not there")?;
        let positions = numbers::<f64>(elements(source, "float_array").next().and_then(|it| it.text()))?;

        let first = self.soup.0.len();
        let moved = positions
            .as_chunks::<3>()
            .0
            .iter()
            .map(|it| <[f64; 3]>::from(X_WG.transform_point(&Point3::from(*it)).coords));
        self.soup.0.extend(moved);
        let counts = numbers::<usize>(elements(primitive, "vcount").next().and_then(|it| it.text()))?;
        for list in elements(primitive, "p") {
            let all = numbers::<usize>(list.text())?;
            let corners: Vec<usize> = all.iter().skip(offset(vertex)).step_by(stride).copied().collect();
            let sizes: Vec<usize> = match kind {
                "polylist" => counts.clone(),
                "polygons" => vec![corners.len()],
                _ => vec![3; corners.len() / 3],
            };
            let mut rest = &corners[..];
            for size in sizes {
                let (face, others) = rest.split_at_checked(size).ok_or("fewer corners than faces need")?;
                rest = others;
                for pair in face.get(1..).unwrap_or_default().windows(2) {
                    let corner = |index: usize| u32::try_from(first.saturating_add(index)).map_err(|it| it.to_string());
                    self.soup.1.push([corner(face[0])?, corner(pair[0])?, corner(pair[1])?]);
                }
            }
            if self.soup.1.len() > MOST_TRIANGLES {
                return Err(format!("more than {MOST_TRIANGLES} triangles"));
            }
        }
        Ok(())
    }
}

/// What an element does to the frame of a node; the identity for one that is no transformation.
fn transform(node: Node) -> Matrix4<f64> {
    let values = || numbers::<f64>(node.text()).unwrap_or_default();
    match (node.tag_name().name(), &values()[..]) {
        ("matrix", values) if values.len() == 16 => Matrix4::from_row_slice(values),
        ("translate", &[x, y, z]) => Matrix4::new_translation(&Vector3::new(x, y, z)),
        ("scale", &[x, y, z]) => Matrix4::new_nonuniform_scaling(&Vector3::new(x, y, z)),
        ("rotate", &[x, y, z, degrees]) => Unit::try_new(Vector3::new(x, y, z), 1e-9)
            .map_or_else(Matrix4::identity, |axis| {
                Rotation3::from_axis_angle(&axis, degrees.to_radians()).to_homogeneous()
            }),
        _ => Matrix4::identity(),
    }
}

fn elements<'a>(node: Node<'a, 'a>, name: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |it| it.tag_name().name() == name)
}

fn numbers<T: std::str::FromStr>(text: Option<&str>) -> Result<Vec<T>, String> {
    let words = text.unwrap_or_default().split_whitespace();
    words
        .map(|word| word.parse().map_err(|_| format!("`{}` for a number", word.chars().take(40).collect::<String>())))
        .collect()
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
        let (vertices, triangles) = read("a.dae", SQUARE.as_bytes()).unwrap();
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3]]);
        let expected = Vector3::new(1.0, 1.0, 0.5);
        assert!((Vector3::from(vertices[2]) - expected).norm() < 1e-12, "{:?}", vertices[2]);
    }

    #[test]
    fn faults_are_told() {
        for (from, to) in [
            ("<vcount>4</vcount>", "<vcount>5</vcount>"),
            ("0 0 1 0 2", "0 0 x 0 2"),
            ("COLLADA xmlns", "collada xmlns"),
            ("\"#v\"", "\"#none\""),
            ("polylist", "tristrips"),
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
}
