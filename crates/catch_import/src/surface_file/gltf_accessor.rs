//! Rows of numbers in the buffers of a glTF file.

use std::borrow::Cow;

use catch_body::{InputError, document::Node, quantity::Quantity};

/// Indices of what a document has, and lengths in bytes.
const INDEX: Quantity = Quantity { least: 0.0, most: 4e9, unit: "" };
/// Rows of an accessor at most.
const MOST_ROWS: usize = 10_000_000;

/// Buffers, and what says where in them something is.
pub(super) struct Buffers<'a> {
    pub views: Vec<Node<'a>>,
    pub accessors: Vec<Node<'a>>,
    pub buffers: Vec<Cow<'a, [u8]>>,
}

impl Buffers<'_> {
    /// Marks views and accessors that nothing refers to, such as those of normals, as left out.
    pub fn leave_out_unused(&self) {
        let unused = self.views.iter().chain(&self.accessors).filter(|node| !node.is_asked());
        unused.for_each(|node| node.leave_out());
    }

    fn view(&self, node: Node) -> Result<(&[u8], Option<usize>), InputError> {
        let missing = || node.fault(format!("{}, which is not there", node.text()), "a number of bufferViews");
        let view = *self.views.get(index(node)?).ok_or_else(missing)?;
        let number = |name| view.child(name).map(index).transpose();
        let (start, length) = (number("byteOffset")?.unwrap_or(0), number("byteLength")?.unwrap_or(0));
        let buffer = number("buffer")?.and_then(|it| self.buffers.get(it)).ok_or_else(missing)?;
        let bytes = buffer.get(start..start.saturating_add(length)).ok_or_else(|| ends_early(view))?;
        if let Some(unread) = view.child("extensions") {
            return Err(unread.fault("a view with an extension", "data that is not compressed"));
        }
        Ok((bytes, number("byteStride")?.filter(|it| *it > 0)))
    }
}

/// The number that a value is, of an entry of a list or of bytes.
pub(super) fn index(node: Node) -> Result<usize, InputError> {
    node.number(INDEX).map(|it| it as usize)
}

fn ends_early(node: Node) -> InputError {
    node.fault("a buffer that ends early", "as many bytes as are said")
}

/// The numbers of the accessor that `node` names, row by row.
pub(super) fn rows(buffers: &Buffers, node: Node, kind: &str) -> Result<Vec<f64>, InputError> {
    let missing = || node.fault(format!("accessor {}, which is not there", node.text()), "a number of accessors");
    let accessor = *buffers.accessors.get(index(node)?).ok_or_else(missing)?;
    let number = |name| accessor.child(name).map_or(Ok(0), index);
    let (start, count, of_type) = (number("byteOffset")?, number("count")?, number("componentType")?);
    let said = accessor.child("type").map_or("", Node::text);
    if said != kind || count > MOST_ROWS {
        return Err(accessor.fault(format!("{count} rows of {said}"), format!("at most {MOST_ROWS} rows of {kind}")));
    }
    let columns = if kind == "VEC3" { 3 } else { 1 };
    let width = match (columns, of_type) {
        (1, 5121) => 1,
        (1, 5123) => 2,
        (1, 5125) | (3, 5126) => 4,
        (_, other) => {
            let found = format!("componentType {other} for {columns} columns");
            return Err(accessor.fault(found, "floats for places, whole numbers for indices"));
        }
    };
    let view = accessor.child("bufferView").ok_or_else(|| accessor.fault("no bufferView", "data"))?;
    let (bytes, stride) = buffers.view(view)?;
    let length = width * columns;
    // A row may begin again and again at one place, so the length of the buffer does not bound their number.
    let mut numbers = Vec::with_capacity(count.min(bytes.len() + 1) * columns);
    for row in 0..count {
        let first = start.saturating_add(row.saturating_mul(stride.unwrap_or(length)));
        let row = bytes.get(first..).and_then(|it| it.get(..length)).ok_or_else(|| ends_early(accessor))?;
        numbers.extend(row.chunks_exact(width).map(|it| match *it {
            [a, b, c, d] if columns == 3 => f64::from(f32::from_le_bytes([a, b, c, d])),
            [a, b, c, d] => f64::from(u32::from_le_bytes([a, b, c, d])),
            [a, b] => f64::from(u16::from_le_bytes([a, b])),
            _ => f64::from(it[0]),
        }));
    }
    Ok(numbers)
}
