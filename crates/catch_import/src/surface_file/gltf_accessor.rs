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
    let number = |of: Node<'_>, name| of.child(name).map(index).transpose();
    let (start, count) = (number(accessor, "byteOffset")?.unwrap_or(0), number(accessor, "count")?.unwrap_or(0));
    let of_type = number(accessor, "componentType")?.unwrap_or(0);
    let said = accessor.child("type").map_or("", Node::text);
    if said != kind || count > MOST_ROWS {
        return Err(accessor.fault(format!("{count} rows of {said}"), format!("at most {MOST_ROWS} rows of {kind}")));
    }
    let layout = Layout { columns: if kind == "VEC3" { 3 } else { 1 }, of_type };
    let view = accessor.child("bufferView");
    let sparse = accessor.child("sparse");
    let mut numbers = match view {
        Some(view) => {
            let (bytes, stride) = buffers.view(view)?;
            layout.read((bytes, start, stride), count, accessor)?
        }
        // As the format says, zeros of which some have other values.
        None if sparse.is_some() => vec![0.0; count * layout.columns],
        None => return Err(accessor.fault("no bufferView", "data")),
    };
    if let Some(sparse) = sparse {
        let count = number(sparse, "count")?.unwrap_or(0);
        let part = |name| sparse.child(name).ok_or_else(|| sparse.fault(format!("no {name}"), "indices and values"));
        let column = |part: Node<'_>, layout: Layout| {
            let view = part.child("bufferView").ok_or_else(|| part.fault("no bufferView", "data"))?;
            let (bytes, _) = buffers.view(view)?;
            layout.read((bytes, number(part, "byteOffset")?.unwrap_or(0), None), count, part)
        };
        let indices = part("indices")?;
        let of_type = number(indices, "componentType")?.unwrap_or(0);
        let (at, values) = (column(indices, Layout { columns: 1, of_type })?, column(part("values")?, layout)?);
        for (at, row) in at.iter().zip(values.chunks_exact(layout.columns)) {
            let first = *at as usize * layout.columns;
            let place = numbers.get_mut(first..first + layout.columns);
            place.ok_or_else(|| sparse.fault(format!("row {at}"), "a row that is there"))?.copy_from_slice(row);
        }
    }
    Ok(numbers)
}

/// Layout of the numbers of a row.
#[derive(Clone, Copy)]
struct Layout {
    columns: usize,
    of_type: usize,
}

impl Layout {
    fn read(
        self,
        (bytes, start, stride): (&[u8], usize, Option<usize>),
        count: usize,
        place: Node,
    ) -> Result<Vec<f64>, InputError> {
        let width = match (self.columns, self.of_type) {
            (1, 5121) => 1,
            (1, 5123) => 2,
            (1, 5125) | (3, 5126) => 4,
            (columns, other) => {
                let found = format!("componentType {other} for {columns} columns");
                return Err(place.fault(found, "floats for places, whole numbers for indices"));
            }
        };
        let length = width * self.columns;
        let stride = stride.unwrap_or(length);
        // A row may begin again and again at one place, so the length of the buffer does not bound their
        // number.
        let mut numbers = Vec::with_capacity(count.min(bytes.len() + 1) * self.columns);
        for row in 0..count {
            let first = start.saturating_add(row.saturating_mul(stride));
            let row = bytes.get(first..).and_then(|it| it.get(..length)).ok_or_else(|| ends_early(place))?;
            numbers.extend(row.chunks_exact(width).map(|it| match *it {
                [a, b, c, d] if self.columns == 3 => f64::from(f32::from_le_bytes([a, b, c, d])),
                [a, b, c, d] => f64::from(u32::from_le_bytes([a, b, c, d])),
                [a, b] => f64::from(u16::from_le_bytes([a, b])),
                _ => f64::from(it[0]),
            }));
        }
        Ok(numbers)
    }
}
