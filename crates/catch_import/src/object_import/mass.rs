//! Mass properties that a description states, and which of them are to be believed.

use catch_body::{TriangleMesh, quantity, robot::Inertia};
use nalgebra::{Matrix3, Point3, Vector3};

/// Density of an object of which nobody states it, in kg/m³: fruit, full bottles and boxes are near water,
/// hollow things are lighter.
const ASSUMED_KGPM3: f64 = 500.0;
/// A stated moment of inertia is that of the shape within this factor.
const INERTIA_FACTOR: f64 = 2.5;
/// A centre of mass that nobody measured is not believed if the shape's is further off than this fraction of
/// its length.
const OFF: f64 = 0.05;

/// Mass properties for an object's file.
#[derive(Debug, Clone)]
pub(super) struct Stated {
    pub mass_kg: f64,
    /// Reason why the mass is assumed, if it is.
    pub assumed: Option<String>,
    /// Centre of mass in the frame of the surface; `None` for that of uniform density.
    pub com: Option<Point3<f64>>,
    /// Moments of inertia about the centre of mass along the axes of the surface; `None` for those of uniform
    /// density.
    pub about_com: Option<Matrix3<f64>>,
    /// Statements that were not believed, each with its reason.
    pub findings: Vec<String>,
}

impl Stated {
    /// Compares what a description states with a solid of uniform density; `mass_kg` is given by hand.
    pub fn of(inertia: Option<Inertia>, solid: &TriangleMesh, mass_kg: Option<f64>) -> Self {
        let mut stated = Self { mass_kg: 0.0, assumed: None, com: None, about_com: None, findings: Vec::new() };
        let believable = |it: &f64| quantity::THROWN_MASS_KG.contains(*it);
        // Sums of parts have more digits than anybody stated.
        let of_file = inertia.map(|it| (it.mass * 1e9).round() / 1e9);
        stated.mass_kg = mass_kg.or(of_file.filter(believable)).unwrap_or_else(|| {
            let range = quantity::THROWN_MASS_KG;
            let of_volume = (ASSUMED_KGPM3 * solid.volume()).clamp(range.least, range.most);
            let mass_kg = format!("{of_volume:.4}").parse().unwrap_or(range.least);
            let said =
                of_file.map_or("no file says a mass".into(), |it| format!("{it} kg is no mass of a thrown object"));
            let reason = format!("{said}: {mass_kg} kg assumed, {ASSUMED_KGPM3} kg/m³ (`--mass` says otherwise)");
            stated.findings.push(reason.clone());
            stated.assumed = Some(reason);
            mass_kg
        });
        let Some(inertia) = inertia.filter(|it| believable(&it.mass)) else { return stated };
        let uniform = solid.mass_properties(stated.mass_kg);
        let moments = inertia.about_com * (stated.mass_kg / inertia.mass);
        stated.about_com = stated.believed_inertia(moments, has_one_digit(&inertia.about_com), &uniform, solid);
        stated.com = stated.believed_com(inertia.com, &uniform, solid);
        stated
    }

    fn believed_com(&mut self, com: Point3<f64>, uniform: &Inertia, solid: &TriangleMesh) -> Option<Point3<f64>> {
        let bounds = solid.aabb();
        let mm = |p: &Vector3<f64>| format!("[{:.1}, {:.1}, {:.1}] mm", p.x * 1e3, p.y * 1e3, p.z * 1e3);
        let off_m = (com - uniform.com).norm();
        let outside = (com - bounds.centre).abs().iter().zip(bounds.size.iter()).any(|(off, size)| 2.0 * off > *size);
        let is_off = off_m > OFF * bounds.size.max();
        let reason = if outside {
            "outside of the shape"
        } else if is_off && com.coords.norm() < 1e-9 {
            "the origin of the frame, as where nobody says it"
        } else if is_off && self.about_com.is_none() {
            "beside that of the shape, and the moments beside it are not measured either"
        } else {
            self.findings.push(format!("centre of mass as stated, {:.1} mm from that of uniform density", off_m * 1e3));
            return Some(com);
        };
        let (com, used) = (mm(&com.coords), mm(&uniform.com.coords));
        self.findings.push(format!("the stated centre of mass, {com}, is {reason}: that of uniform density, {used}"));
        None
    }

    fn believed_inertia(
        &mut self,
        about_com: Matrix3<f64>,
        has_one_digit: bool,
        uniform: &Inertia,
        solid: &TriangleMesh,
    ) -> Option<Matrix3<f64>> {
        if about_com == Matrix3::zeros() {
            self.findings.push("no file says moments of inertia: those of uniform density".to_owned());
            return None;
        }
        let sorted = |inertia: &Matrix3<f64>| {
            let mut moments = <[f64; 3]>::from(inertia.symmetric_eigenvalues());
            moments.sort_by(f64::total_cmp);
            moments
        };
        let (of_file, of_shape) = (sorted(&about_com), sorted(&uniform.about_com));
        let length_m = solid.aabb().size.norm();
        let is_possible = of_file[0] >= 1e-8 * uniform.mass
            && of_file[2] <= of_file[0] + of_file[1]
            && of_file[2] <= uniform.mass * length_m * length_m;
        let ratios = [0, 1, 2].map(|i| of_file[i] / of_shape[i]);
        let is_like = ratios.iter().all(|it| (1.0 / INERTIA_FACTOR..INERTIA_FACTOR).contains(it));
        // A box of 1 × 1 × 1, whatever the shape: nobody measured that.
        let is_round = of_file[2] <= of_file[0] * 1.001 && of_shape[2] > of_shape[0] * 1.2;
        if is_possible && is_like && !is_round && !has_one_digit {
            return Some(about_com);
        }
        let list = |it: [f64; 3]| it.map(|value| format!("{value:.1e}")).join(", ");
        let kind = if is_round {
            "equal about all axes"
        } else if !is_possible {
            "no body's"
        } else if is_like {
            "rounded to one digit"
        } else {
            "not near the shape's"
        };
        self.findings.push(format!(
            "the stated moments of inertia, {} kg·m², are {kind}: those of uniform density, {} kg·m²",
            list(of_file),
            list(of_shape)
        ));
        None
    }
}

/// Returns whether all moments are written with one digit, which may be off by half of itself: the shape then
/// gives them better.
fn has_one_digit(inertia: &Matrix3<f64>) -> bool {
    inertia.diagonal().iter().all(|&moment| {
        let rounded: f64 = format!("{moment:.0e}").parse().unwrap_or(f64::NAN);
        (rounded - moment).abs() <= 1e-9 * moment.abs()
    })
}
