//! The edges of a surface, and the triangles that meet there.

/// A side of a triangle: its lower and its higher vertex, and its number, three times that of the triangle
/// and that of its start.
pub(super) type Side = (u32, u32, u32);

/// Sides of triangles, edge by edge.
pub(super) struct Edges {
    sides: Vec<Side>,
}

impl Edges {
    /// The edges of `triangles`.
    pub fn of(triangles: &[[u32; 3]]) -> Self {
        let of_triangle = |(i, &[a, b, c]): (u32, &[u32; 3])| {
            [(a, b, 0), (b, c, 1), (c, a, 2)].map(|(from, to, k)| (from.min(to), from.max(to), 3 * i + k))
        };
        let mut sides: Vec<Side> = (0..).zip(triangles).flat_map(of_triangle).collect();
        sides.sort_unstable();
        Self { sides }
    }

    /// Groups of the sides that run along the same edge, edge by edge.
    pub fn groups(&self) -> impl Iterator<Item = &[Side]> {
        self.sides.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
    }

    /// Edges with an odd number of sides, at which a surface is open.
    pub fn open(&self) -> impl Iterator<Item = &[Side]> {
        self.groups().filter(|it| it.len() % 2 == 1)
    }
}
