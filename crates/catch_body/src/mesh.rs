//! x
pub struct TriangleMesh;
