//! The files of an imported object.

use catch_body::{TriangleMesh, mesh_file::obj_text, quantity};
use catch_sim::object::hull_area_m2;

use super::mass::Stated;

/// Density of air in kg/m³.
const AIR_KGPM3: f64 = 1.2;
/// Drag coefficient of something that tumbles; blunt bodies have about this one.
const DRAG_COEFFICIENT: f64 = 0.9;
/// Standard deviation of each coordinate of the centre of mass about that of uniform density, which few
/// objects have.
const COM_SD_M: f64 = 0.005;
/// Coefficient of restitution where nobody states one.
const RESTITUTION: f64 = 0.4;

/// An object's files while they are written.
pub(super) struct Draft<'a> {
    pub name: String,
    pub source: String,
    pub mesh: &'a TriangleMesh,
    pub parts: Vec<TriangleMesh>,
    pub stated: &'a Stated,
    pub friction: Option<f64>,
    pub restitution: Option<f64>,
}

impl Draft<'_> {
    /// Text of the object's `truth.toml`.
    pub fn truth_toml(&self) -> String {
        let Stated { mass_kg, assumed, com, about_com, .. } = self.stated;
        let drag_per_m = self.drag_per_m();
        let mut text = format!("# Imported: {}.\nname = {:?}\n\n", self.source.replace(['\n', '\r'], " "), self.name);
        text += "# What it truly is. Only the arena reads this table.\n[truth]\n";
        let mut add = |line: String| text += &(line + "\n");
        if let Some(reason) = assumed {
            add(format!("# Assumed: {reason}."));
        }
        add(format!("mass_kg = {mass_kg}"));
        if self.restitution.is_none() {
            add("# Assumed: nobody says how it bounces.".into());
        }
        add(format!("restitution = {:?}", self.restitution.unwrap_or(RESTITUTION)));
        add(format!(
            "# Assumed: ½·ρ·C_D·A/m with C_D = {DRAG_COEFFICIENT} and A the mean silhouette of its convex hull.\n\
             drag_per_m = {drag_per_m}"
        ));
        if let Some(com) = com {
            add(format!("com_m = [{:.6}, {:.6}, {:.6}]", com.x, com.y, com.z));
        }
        if let Some(inertia) = about_com {
            let entries = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| format!("{:e}", inertia[at]));
            add(format!(
                "# ixx, ixy, ixz, iyy, iyz, izz about the centre of mass.\ninertia_kgm2 = [{}]",
                entries.join(", ")
            ));
        }
        if let Some(friction) = self.friction {
            add(format!("friction = {friction:?}"));
        }
        add("\n[truth.shape]\nkind = \"mesh\"".into());
        add(format!("file = {:?}", self.mesh_file()));
        if !self.parts.is_empty() {
            add(format!("parts = [{:?}]", self.parts_file()));
        }
        text
    }

    /// Text of the object's `known.toml`.
    pub fn known_toml(&self) -> String {
        let (mass_kg, drag_per_m) = (self.stated.mass_kg, self.drag_per_m());
        let drag_sd = (drag_per_m * 0.3 * 1e4).round() / 1e4;
        format!(
            "# What is known beforehand, beside a scan of the object from all sides. Only the brain reads this table.\n[known]\n\
             mass_kg = {mass_kg}\ndrag_per_m = {drag_per_m}\ndrag_sd_per_m = {}\nrestitution = {:?}\n\
             # Assumed: how far its centre of mass may be from that of uniform density.\ncom_sd_m = {COM_SD_M:?}\n",
            drag_sd.max(1e-4),
            self.restitution.unwrap_or(RESTITUTION)
        )
    }

    /// The files beside the object's own.
    pub fn files(&self) -> Vec<(String, Vec<u8>)> {
        let mut files = vec![(self.mesh_file(), obj_text(std::slice::from_ref(self.mesh)).into_bytes())];
        if !self.parts.is_empty() {
            files.push((self.parts_file(), obj_text(&self.parts).into_bytes()));
        }
        files
    }

    fn mesh_file(&self) -> String {
        format!("{}.obj", self.name)
    }

    fn parts_file(&self) -> String {
        format!("{}_parts.obj", self.name)
    }

    /// A convex body's mean silhouette is a quarter of its surface (Cauchy).
    fn drag_per_m(&self) -> f64 {
        let silhouette_m2 = hull_area_m2(&self.mesh.vertices) / 4.0;
        let drag = 0.5 * AIR_KGPM3 * DRAG_COEFFICIENT * silhouette_m2 / self.stated.mass_kg;
        let rounded = (drag * 1e4).round() / 1e4;
        rounded.clamp(quantity::DRAG_PER_M.least, quantity::DRAG_PER_M.most)
    }
}
