//! Silhouettes: what pixels at the object's silhouette say.
//!
//! The ray through a pixel that shows the object meets it, the ray through a neighbour that does not passes
//! it by. That holds however bad the depths are: with stereo noise at seven metres the silhouette carries the
//! information. Each such ray is a one-sided bound on the pose, and hundreds of them leave little room: far
//! less than if each told the silhouette's place to within a pixel by itself.

use catch_body::{
    Pose,
    normal_distribution::{bound_cost, inverse_mills},
};
use catch_cell::{CameraModel, PixelWindow};
use nalgebra::{Point3, Vector3};

use super::{
    ReferenceModel, Symmetry,
    edge_growth::EdgeGrowth,
    normal_equations::{CommonError, OUTLIER_SD, Sums},
    reference::MODEL_SD_M,
    segmentation::Label,
    thinning::{KEPT_OF_IMAGE, stride, thin},
    viewpoint::Viewpoint,
};

/// The ray through a pixel at the object's silhouette.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SilhouetteRay {
    /// Origin of the ray: the camera.
    pub p_WC: Point3<f64>,
    /// Direction of the ray, a unit vector.
    pub direction_W: Vector3<f64>,
    /// True if the pixel shows the object.
    pub inside: bool,
    /// The angle that a pixel covers.
    pub pixel_rad: f64,
    /// Number of its image.
    image: usize,
    /// Distance along the ray of the point nearest to the surface (or deepest below it), in metres, and
    /// curvature of the distance there, in 1/m.
    along_m: f64,
    bend_per_m: f64,
    /// Signed distance of that place from the surface, in metres; the place and the gradient there, both in
    /// O.
    distance_m: f64,
    p_O: Point3<f64>,
    n_O: Vector3<f64>,
    /// Direction of the ray in O.
    direction_O: Vector3<f64>,
    /// Standard deviation of the silhouette there, in metres.
    sd_m: f64,
    /// Displacement of the object up to the last evaluation of the ray, in metres.
    seen_after_m: f64,
}

/// Standard deviation in pixels by which the object's silhouette in an image may be off: not by the pixels'
/// size, which is allowed for, but by the mask's and the cameras' own errors.
const SILHOUETTE_SD_PX: f64 = 0.015;
/// Silhouettes are used once the points lie further than this from the reference, root mean square in metres:
/// below it they would add nothing but time.
pub(super) const SILHOUETTE_ABOVE_M: f64 = 0.001;
/// Standard deviations by which a bound must be kept before it no longer matters.
const IDLE_SD: f64 = 3.0;
/// Displacement of the object in metres, and growth of the silhouette's scale, after which all rays are
/// evaluated again.
const NEARBY_M: f64 = 0.002;
const SCALE_GROWTH: f64 = 1.5;
/// Bends of the distance along a ray that are believed, in 1/m: radii from 2 mm to 0.5 m.
const BENDS_PER_M: [f64; 2] = [2.0, 500.0];

/// Standard deviations by which a bound must be kept for its search to end.
const CLEAR_SD: f64 = 4.0;
/// Range in metres over which a parabola along the ray is trusted: two nodes of the distance field.
const BELIEVED_M: f64 = 0.004;
/// Steps of the search for the nearest place, and the shortest that is worth a look.
const SECANTS: usize = 3;
const LEAST_STEP_M: f64 = 5e-4;

impl SilhouetteRay {
    /// A ray that has not been near an object.
    pub fn new(p_WC: Point3<f64>, direction_W: Vector3<f64>, inside: bool, pixel_rad: f64, image: usize) -> Self {
        let (bend_per_m, sd_m) = (20.0, 1.0);
        Self { p_WC, direction_W, inside, pixel_rad, image, bend_per_m, sd_m, ..Self::default() }
    }

    /// Violation of the bound in metres, where the object has grown as `edges` say; negative if it is kept.
    fn violation_m(&self, edges: &[EdgeGrowth]) -> f64 {
        if self.inside { self.beyond_m(edges) } else { -self.beyond_m(edges) }
    }

    /// Distance in metres by which the ray passes beside the grown object; negative if it meets it.
    fn beyond_m(&self, edges: &[EdgeGrowth]) -> f64 {
        self.distance_m - edges[self.image].px * self.pixel_m()
    }

    /// Size of a pixel at the nearest point of the ray, in metres.
    fn pixel_m(&self) -> f64 {
        self.pixel_rad * self.along_m
    }

    fn note(&mut self, moved_m: f64, edges: &[EdgeGrowth]) {
        self.seen_after_m = moved_m;
        let in_image_m = edges[self.image].place_sd_px * self.pixel_rad * self.along_m;
        self.sd_m = (in_image_m * in_image_m + MODEL_SD_M * MODEL_SD_M).sqrt();
    }

    /// Returns whether the bound is kept by so much that it does not matter after the object has moved by
    /// `moved_m`.
    fn is_idle(&self, moved_m: f64, scale: f64, edges: &[EdgeGrowth]) -> bool {
        self.violation_m(edges) + (moved_m - self.seen_after_m) < -IDLE_SD * scale * self.sd_m
    }

    /// Finds the nearest place to the surface anew: from where its `neighbour` of the same camera came
    /// nearest, or else from the best of where it passes the object's centre and halfway to either side.
    fn find(&mut self, reference: &ReferenceModel, view: &Viewpoint, neighbour: Option<&Self>) {
        let p_OC = view.p_OC;
        let direction_O = view.R_OW * self.direction_W;
        self.direction_O = direction_O;
        let middle_m = self.along_m;
        let passes_m = (p_OC + direction_O * middle_m).coords.norm();
        let clear_m = CLEAR_SD * self.sd_m;
        if passes_m > reference.radius_m + clear_m {
            // It misses the ball that holds the object.
            (self.distance_m, self.p_O) = (passes_m - reference.radius_m, p_OC + direction_O * middle_m);
            self.n_O = self.p_O.coords / passes_m;
            self.bend_per_m = 1.0 / passes_m;
            return;
        }
        let half_m = (reference.radius_m.powi(2) - passes_m * passes_m).max(0.0).sqrt();
        let look = |along_m: f64| reference.distance.at(&(p_OC + direction_O * along_m));
        self.bend_per_m = neighbour.map_or(1.0 / reference.radius_m.max(0.005), |neighbour| neighbour.bend_per_m);
        let hint_m =
            neighbour.map(|neighbour| neighbour.along_m).filter(|along_m| (along_m - middle_m).abs() <= half_m);
        let first_m = hint_m.unwrap_or(middle_m);
        self.along_m = first_m;
        let (mut least_m, mut gradient) = look(first_m);
        // A neighbour is hint enough, unless the ray does not do there what its pixel says. Elsewhere the
        // coarse nodes choose.
        let is_sure = reference.symmetry == Symmetry::Sphere || hint_m.is_some() && (least_m < 0.0) == self.inside;
        let coarsely = |along_m| (reference.distance.about_m(&(p_OC + direction_O * along_m)), along_m);
        let elsewhere = [middle_m, middle_m - 0.5 * half_m, middle_m + 0.5 * half_m].into_iter().filter(|_| !is_sure);
        if let Some((_, along_m)) = elsewhere.map(coarsely).min_by(|a, b| a.0.total_cmp(&b.0)) {
            let (distance_m, gradient_there) = look(along_m);
            if distance_m < least_m {
                (least_m, gradient, self.along_m) = (distance_m, gradient_there, along_m);
            }
        }
        // Secants towards where the distance along the ray has no slope, cut in half where they lead up.
        let mut reach_m = 0.5 * reference.radius_m;
        for _ in 0..SECANTS {
            let slope = gradient.dot(&direction_O);
            let step = (-slope / self.bend_per_m).clamp(-reach_m, reach_m);
            let kept = if self.inside { least_m < -clear_m } else { least_m + 0.5 * slope * step > clear_m };
            if kept || step.abs() < LEAST_STEP_M {
                break;
            }
            let (distance_m, gradient_there) = look(self.along_m + step);
            let [low, high] = BENDS_PER_M;
            self.bend_per_m = ((gradient_there.dot(&direction_O) - slope) / step).clamp(low, high);
            if distance_m < least_m {
                (least_m, gradient, self.along_m) = (distance_m, gradient_there, self.along_m + step);
            } else {
                reach_m = 0.5 * step.abs();
            }
        }
        self.settle(least_m, &gradient, &p_OC, &direction_O);
    }

    /// Looks where the ray passes what was nearest to it last: the place moves along the ray with the object.
    fn follow(&mut self, reference: &ReferenceModel, view: &Viewpoint) {
        let direction_O = view.R_OW * self.direction_W;
        self.along_m = direction_O.dot(&(self.p_O - view.p_OC));
        let (distance_m, gradient) = reference.distance.at(&(view.p_OC + direction_O * self.along_m));
        self.settle(distance_m, &gradient, &view.p_OC, &direction_O);
    }

    /// Takes the distance and its gradient where the ray was looked at, and corrects for what the nearest
    /// place is beside it.
    fn settle(&mut self, distance_m: f64, gradient: &Vector3<f64>, p_OC: &Point3<f64>, direction_O: &Vector3<f64>) {
        // The parabola f + g·s + ½b·s² is lowest at s = −g/b, by g²/2b, and there its gradient is across the
        // ray.
        let slope = gradient.dot(direction_O);
        let ahead_m = (-slope / self.bend_per_m).clamp(-BELIEVED_M, BELIEVED_M);
        self.distance_m = distance_m + (slope + 0.5 * self.bend_per_m * ahead_m) * ahead_m;
        self.along_m += ahead_m;
        self.p_O = p_OC + direction_O * self.along_m;
        self.direction_O = *direction_O;
        self.n_O = gradient - direction_O * slope;
        self.n_O /= self.n_O.norm().max(0.3);
    }
}

/// The silhouette of an object in one set of images: its rays, and those few of them that matter while the
/// object moves little.
#[derive(Debug, Clone, Default)]
pub struct Silhouette {
    rays: Vec<SilhouetteRay>,
    /// Growth of the object in each image.
    edges: Vec<EdgeGrowth>,
    /// Numbers of the rays that matter.
    near: Vec<u32>,
    /// Displacement of the object when they were chosen, and the scale up to which no other rays matter.
    moved_m: f64,
    most_scale: f64,
}

impl Silhouette {
    /// Forgets all rays and makes room for `count`, so that collecting them does not allocate.
    pub(super) fn clear(&mut self, count: usize) {
        self.rays.clear();
        self.edges.clear();
        self.near.clear();
        self.rays.reserve(count);
        self.near.reserve(count);
    }

    /// Returns whether there are no rays.
    pub fn is_empty(&self) -> bool {
        self.rays.is_empty()
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.rays.len()
    }

    /// Takes over at most about `most` of another silhouette's rays, evenly.
    pub(super) fn thin_from(&mut self, other: &Self, most: usize) {
        self.rays.clear();
        self.rays.extend(other.rays.iter().step_by(stride(other.rays.len(), most)));
        self.edges.clone_from(&other.edges);
    }

    /// Brings all rays to the object at `X_WO`, from scratch; all of them matter.
    pub(super) fn find(&mut self, reference: &ReferenceModel, X_WO: &Pose) {
        let mut view = Viewpoint::new(X_WO);
        let mut neighbour: Option<SilhouetteRay> = None;
        self.edges.iter_mut().for_each(|it| it.reset(SILHOUETTE_SD_PX));
        for ray in &mut self.rays {
            if view.look_from(&ray.p_WC) {
                neighbour = None;
            }
            // Where it passes the object's centre.
            ray.along_m = -view.p_OC.coords.dot(&(view.R_OW * ray.direction_W));
            ray.note(0.0, &self.edges);
            ray.find(reference, &view, neighbour.as_ref());
            ray.note(0.0, &self.edges);
            neighbour = Some(*ray);
        }
        (self.moved_m, self.most_scale) = (0.0, f64::INFINITY);
        self.near.clear();
        self.near.extend(0..self.rays.len() as u32);
    }

    /// Chooses those that matter anew.
    pub(super) fn choose(&mut self, moved_m: f64, scale: f64) {
        (self.moved_m, self.most_scale) = (moved_m, SCALE_GROWTH * scale);
        self.near.clear();
        let matters = |ray: &SilhouetteRay| !ray.is_idle(moved_m + NEARBY_M, SCALE_GROWTH * scale, &self.edges);
        self.near.extend((0_u32..).zip(&self.rays).filter(|(_, ray)| matters(ray)).map(|(i, _)| i));
    }

    /// Brings those rays to the object at `X_WO` that may matter after it has moved by `moved_m` in all since
    /// [`find`](Self::find).
    pub(super) fn follow(&mut self, reference: &ReferenceModel, X_WO: &Pose, moved_m: f64, scale: f64) {
        if moved_m > self.moved_m + NEARBY_M || scale > self.most_scale {
            self.choose(moved_m, scale);
        }
        let mut view = Viewpoint::new(X_WO);
        for &i in &self.near {
            let ray = &mut self.rays[i as usize];
            if !ray.is_idle(moved_m, scale, &self.edges) {
                view.look_from(&ray.p_WC);
                ray.follow(reference, &view);
                ray.note(moved_m, &self.edges);
            }
        }
    }

    /// The rays that matter.
    fn near(&self) -> impl Iterator<Item = &SilhouetteRay> {
        self.near.iter().map(|&i| &self.rays[i as usize])
    }

    /// Root mean square by which broken bounds are broken, in multiples of what it should be: √⅔ standard
    /// deviations, since E\[u²; u > 0\] = ∫u²·Φ(−u)du / ∫Φ(−u)du = ⅔ for rays at any distance from the
    /// silhouette.
    pub(super) fn typical_violation(&self, scale: f64) -> f64 {
        let (mut weights, mut squares) = (0.0, 0.0);
        for ray in self.near().filter(|ray| ray.violation_m(&self.edges) > 0.0) {
            let in_sd = ray.violation_m(&self.edges) / ray.sd_m;
            let weight = (1.0 + (in_sd / (OUTLIER_SD * scale)).powi(2)).powi(-2);
            weights += weight;
            squares += weight * in_sd * in_sd;
        }
        // A violation of half a standard deviation on top, so that a single ray does not decide.
        ((squares + 2.0 / 3.0) / (weights + 1.0) * 1.5).sqrt()
    }

    /// Mean square over all rays by which bounds are broken, in standard deviations; what is broken by more
    /// than outliers are counts like them, so that every ray that says otherwise has one vote.
    pub(super) fn mean_square(&self) -> f64 {
        let broken = self.near().map(|ray| (ray.violation_m(&self.edges) / ray.sd_m).clamp(0.0, OUTLIER_SD));
        broken.map(|in_sd| in_sd * in_sd).sum::<f64>() / self.len().max(1) as f64
    }

    /// −2 × the log-likelihood of what all pixels show, up to a constant. The cost of each ray saturates at
    /// the square of [`OUTLIER_SD`].
    pub(super) fn cost(&self) -> f64 {
        let costs = self.near().map(|ray| 2.0 * bound_cost(ray.violation_m(&self.edges) / ray.sd_m));
        costs.map(|cost| cost / (1.0 + cost / (OUTLIER_SD * OUTLIER_SD))).sum()
    }

    /// Sums over the rays where they are: each costs −ln Φ(−u), u being by how many standard deviations its
    /// bound is broken. How far the object has grown in an image is eliminated, and then brought to where
    /// that cost is least.
    pub(super) fn sum(&mut self, scale: f64) -> Sums {
        let Self { rays, edges, near, .. } = self;
        let mut sums = Sums::default();
        for of_image in near.chunk_by(|a, b| rays[*a as usize].image == rays[*b as usize].image) {
            let image = rays[of_image[0] as usize].image;
            let growth_sd_px = edges[image].sd_px();
            let mut growth = (growth_sd_px > 0.0).then(|| CommonError::new(edges[image].beyond_expected()));
            for ray in of_image.iter().map(|&i| &rays[i as usize]) {
                let violation_m = ray.violation_m(edges);
                let sd_m = ray.sd_m * scale;
                let u = violation_m / sd_m;
                if u < -IDLE_SD {
                    continue;
                }
                let weight = if u > 0.0 { sums.weigh(violation_m, sd_m, 1.0) } else { 1.0 };
                // λ = φ(u)/Φ(−u), and the cost's curvature λ·(λ − u).
                let mills = inverse_mills(u);
                let sign = if ray.inside { 1.0 } else { -1.0 };
                let slope = sign * weight * mills / sd_m;
                let curvature = weight * mills * (mills - u) / (sd_m * sd_m);
                let Some(growth) = &mut growth else {
                    sums.equations.add(&ray.p_O, &ray.n_O, curvature, slope);
                    continue;
                };
                // Blur is an angle: what it covers grows with the distance, and must not be what makes the
                // object seem farther away.
                let n_O = ray.n_O + ray.direction_O * (ray.distance_m / ray.along_m);
                sums.equations.add(&ray.p_O, &n_O, curvature, slope);
                growth.add(&ray.p_O, &n_O, curvature, slope, -growth_sd_px * ray.pixel_m());
            }
            if let Some(growth) = growth {
                sums.equations.eliminate(&growth);
                edges[image].step(-growth.slope / growth.curvature);
            }
        }
        sums
    }

    /// Appends the rays at the silhouette of an object whose pixels lie within `part` of an image's window,
    /// given how wide its edges are and what the pixel at a column and row of the window says.
    pub(super) fn collect(
        &mut self,
        window: PixelWindow,
        camera: &CameraModel,
        part: &PixelWindow,
        edge_px: u32,
        label: impl Fn(usize, usize) -> Label,
    ) {
        let (image, first) = (self.edges.len(), self.rays.len());
        self.edges.push(EdgeGrowth::new(edge_px));
        let (columns, rows) = (window.width as usize, window.height as usize);
        // One pixel more all around, where the image has it.
        let left = ((part.left - window.left) as usize).saturating_sub(1);
        let top = ((part.top - window.top) as usize).saturating_sub(1);
        let right = ((part.left - window.left + part.width) as usize + 1).min(columns);
        let bottom = ((part.top - window.top + part.height) as usize + 1).min(rows);
        let p_WC = Point3::from(camera.X_WC.translation.vector);
        let R_WC = camera.X_WC.rotation.to_rotation_matrix();
        for row in top..bottom {
            for column in left..right {
                let other = match label(column, row) {
                    Label::Object => Label::Elsewhere,
                    Label::Elsewhere => Label::Object,
                    Label::Unknown => continue,
                };
                let at_outline = column > 0 && label(column - 1, row) == other
                    || column + 1 < columns && label(column + 1, row) == other
                    || row > 0 && label(column, row - 1) == other
                    || row + 1 < rows && label(column, row + 1) == other;
                if !at_outline {
                    continue;
                }
                let ray_C = camera.back_project(&window.pixel_centre(row * columns + column), 1.0).coords;
                let length = ray_C.norm();
                let pixel_rad = 1.0 / (camera.focal_px * length);
                let inside = other == Label::Elsewhere;
                self.rays.push(SilhouetteRay::new(p_WC, R_WC * (ray_C / length), inside, pixel_rad, image));
            }
        }
        thin(&mut self.rays, first, KEPT_OF_IMAGE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::synthetic::{self, Shape};

    /// A ball of 30 pixels' radius, whose image has grown by one, as `edge_px` allows for.
    fn grown(edge_px: u32) -> (ReferenceModel, Silhouette) {
        let radius_m: f64 = 0.03;
        let camera = CameraModel {
            X_WC: Pose::translation(0.0, 0.0, -1.0),
            width_px: 100,
            height_px: 100,
            focal_px: 1000.0,
            principal_px: [50.0, 50.0],
            rate_hz: None,
            sheet: None,
        };
        let window = camera.full_window();
        // Seen from one metre the silhouette of a ball is a little larger than its radius.
        let radius_px = 1000.0 * radius_m / (1.0 - radius_m * radius_m).sqrt() + 1.0;
        let mut silhouette = Silhouette::default();
        silhouette.collect(window, &camera, &window, edge_px, |column, row| {
            let beside = libm::hypot(column as f64 - 49.5, row as f64 - 49.5);
            if beside < radius_px { Label::Object } else { Label::Elsewhere }
        });
        (synthetic::reference(&Shape::Sphere { radius: radius_m }, 200), silhouette)
    }

    /// However far the object moves towards the camera, rays pass it as if it was looked for anew.
    #[test]
    fn rays_follow_the_object_along_them() {
        let (reference, mut silhouette) = grown(0);
        silhouette.find(&reference, &Pose::identity());
        for moved_m in [0.002, 0.02, 0.06] {
            let X_WO = Pose::translation(0.0, 0.0, -moved_m);
            let mut anew = silhouette.clone();
            anew.find(&reference, &X_WO);
            silhouette.follow(&reference, &X_WO, moved_m, f64::INFINITY);
            for (followed, found) in silhouette.rays.iter().zip(&anew.rays) {
                let [followed_m, found_m] = [followed, found].map(|it| it.distance_m);
                assert!((followed_m - found_m).abs() < 1e-4, "{moved_m}: {followed_m} {found_m}");
            }
        }
    }

    /// A ball that seems too large is no nearer where edges may grow.
    #[test]
    fn growth_is_told_from_nearness() {
        let along = |edge_px: u32| {
            let (reference, mut silhouette) = grown(edge_px);
            silhouette.find(&reference, &Pose::identity());
            for _ in 0..10 {
                silhouette.sum(1.0);
            }
            let grown_px = silhouette.edges[0].px;
            let (information, gradient) = silhouette.sum(1.0).equations.projected(&nalgebra::Matrix3::identity());
            (grown_px, information[(5, 5)].sqrt().recip(), -gradient[5] / information[(5, 5)])
        };
        let (grown_px, sd_m, step_m) = along(2);
        assert!((grown_px - 1.0).abs() < 0.3, "{grown_px}");
        // A pixel is a thirtieth of a metre.
        assert!(sd_m > 0.01 && step_m.abs() < sd_m, "{sd_m} {step_m}");
        let (_, sd_m, step_m) = along(0);
        assert!(sd_m < 0.005 && step_m < -3.0 * sd_m, "{sd_m} {step_m}");
    }

    /// An outline costs more the farther it is from that of the pixels, but no ray more than an outlier.
    #[test]
    fn an_outline_costs_more_the_farther_it_is_off() {
        let (reference, silhouette) = grown(0);
        let mut before = 0.0;
        for off_px in [0.0, 1.0, 2.0, 4.0] {
            let mut moved = silhouette.clone();
            // A pixel is a millimetre, one metre away.
            moved.find(&reference, &Pose::translation(1e-3 * off_px, 0.0, 0.0));
            let cost = moved.cost();
            assert!(cost > before + 1.0, "{off_px}: {before}, then {cost}");
            assert!(cost < OUTLIER_SD * OUTLIER_SD * moved.len() as f64, "{off_px}: {cost}");
            before = cost;
        }
    }
}
