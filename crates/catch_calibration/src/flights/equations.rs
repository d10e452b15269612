//! Contribution of one flight to the equations of all cameras: residuals, derivatives, and the elimination of
//! the flight's own parameters.

use catch_body::{
    Pose, dynamics,
    free_flight::ballistic::{Law, Motion},
};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, Point3, SMatrix, Vector3};

use super::{FLIGHT_OFFSET_SD_M, Sighting};
use crate::CAMERA_PARAMETERS;

/// Parameters of each camera: those of [`CAMERA_PARAMETERS`], and the registration's offset.
pub const OF_CAMERA: usize = CAMERA_PARAMETERS + OF_OFFSET;
/// An offset of the registration: along x and y of the camera, and along the line of sight.
pub const OF_OFFSET: usize = 3;
/// The two of the tilt come after the cameras.
pub const OF_TILT: usize = 2;
/// A flight's own parameters: position and velocity at its epoch, and drag; an offset of each camera follows.
pub const OF_FLIGHT: usize = 7;
const DRAG: usize = 6;

/// Residuals beyond so many standard deviations count less and less (Huber), and beyond so many more not at
/// all.
const HUBER_SD: f64 = 3.0;
const OUTLIER_SD: f64 = 6.0;
/// Sightings that are all within this time, in seconds, tell of no flight.
const LEAST_SPAN_S: f64 = 0.05;
/// Standard deviation of the drag constant k in a = −k·|v|·v of each flight, in 1/m, about zero.
const DRAG_SD_PER_M: f64 = 0.1;
/// Rounds of the first fit.
const FIRST_ROUNDS: usize = 15;

/// Parameters of one camera.
#[derive(Debug, Clone, Copy)]
pub struct CameraState {
    pub X_WC: Pose,
    pub depth_scale: f64,
    pub time_offset_s: f64,
    pub offset: Vector3<f64>,
}

/// A sighting that counts; its camera is a place among those that are refined.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    pub sighting: Sighting,
    /// L⁻¹ where the covariance is L·Lᵀ.
    whitening: Matrix3<f64>,
}

impl Seen {
    /// A sighting that counts; `None` where it is no number, or its covariance is none.
    pub fn new(sighting: Sighting) -> Option<Self> {
        let Sighting { capture_s, p_C, covariance_C, .. } = &sighting;
        let is_finite = capture_s.is_finite() && p_C.iter().chain(covariance_C.iter()).all(|it| it.is_finite());
        let factor = (is_finite && p_C.norm() > 0.0).then(|| covariance_C.cholesky()).flatten()?;
        let whitening = factor.l().try_inverse().filter(|it| it.iter().all(|entry| entry.is_finite()))?;
        Some(Self { sighting, whitening })
    }

    /// Columns of an offset of the registration.
    fn offset_columns(&self) -> Matrix3<f64> {
        Matrix3::from_columns(&[Vector3::x(), Vector3::y(), self.sighting.p_C.normalize()])
    }
}

/// A flight: its sightings in the order of time, and what is estimated of it.
#[derive(Debug, Clone)]
pub struct FlightState {
    pub seen: Vec<Seen>,
    epoch_s: f64,
    p_W: Vector3<f64>,
    v_W: Vector3<f64>,
    drag_per_m: f64,
    offsets: Vec<Vector3<f64>>,
}

/// Residuals of a sighting and their derivatives, all over its standard deviations.
pub struct Row {
    pub camera: usize,
    pub residual: Vector3<f64>,
    /// Derivatives by the parameters of its camera, and by the tilt.
    pub by_common: SMatrix<f64, 3, { OF_CAMERA + OF_TILT }>,
    /// Derivatives by position, velocity and drag, and by the camera's offset in this flight.
    pub by_own: SMatrix<f64, 3, { OF_FLIGHT + OF_OFFSET }>,
}

/// Information of a flight about the parameters that all flights have in common.
pub struct FlightEquations {
    pub information: DMatrix<f64>,
    pub pull: DVector<f64>,
    /// Sightings that did not count.
    pub outliers: usize,
    own: Cholesky<f64, Dyn>,
    own_pull: DVector<f64>,
    coupling: DMatrix<f64>,
}

/// Inverse variance. A compiler rounds a constant's power otherwise than a processor does.
pub fn inverse_variance(sd: f64) -> f64 {
    (sd * sd).recip()
}

/// The law of motion where the vertical is off by these rotations about x and y of W: g + θ × g. Of the
/// motion's parameters they are the last two.
pub fn law(drag_per_m: f64, [x, y]: [f64; 2]) -> Law<6> {
    let g = dynamics::gravity();
    let mut by_others = SMatrix::<f64, 3, 6>::zeros();
    by_others.set_column(4, &Vector3::x().cross(&g));
    by_others.set_column(5, &Vector3::y().cross(&g));
    Law { drag_per_m, gravity: g + Vector3::new(x, y, 0.0).cross(&g), by_others }
}

impl FlightState {
    /// The flight near whose parabola most sightings lie.
    pub fn new(mut seen: Vec<Seen>, cameras: &[CameraState]) -> Option<Self> {
        let time_s = |it: &Seen| it.sighting.capture_s + cameras[it.sighting.camera].time_offset_s;
        seen.sort_by(|a, b| time_s(a).total_cmp(&time_s(b)));
        let epoch_s = time_s(seen.get(seen.len() / 2)?);
        if time_s(seen.last()?) - time_s(seen.first()?) < LEAST_SPAN_S {
            return None;
        }
        let samples: Vec<(f64, Vector3<f64>, f64)> = seen
            .iter()
            .map(|it| {
                let elapsed_s = time_s(it) - epoch_s;
                let p_W = (cameras[it.sighting.camera].X_WC * Point3::from(it.sighting.p_C)).coords;
                let falling = catch_body::dynamics::gravity() * (0.5 * elapsed_s * elapsed_s);
                (elapsed_s, p_W - falling, it.sighting.covariance_C.trace().sqrt())
            })
            .collect();
        let (mut p_W, mut v_W) = (Vector3::zeros(), Vector3::zeros());
        let mut weights: Vec<f64> = samples.iter().map(|it| it.2.powi(-2)).collect();
        for _ in 0..FIRST_ROUNDS {
            let sum = |of: &dyn Fn(f64) -> f64| samples.iter().zip(&weights).map(|(it, w)| w * of(it.0)).sum::<f64>();
            let (one, t, tt) = (sum(&|_| 1.0), sum(&|t| t), sum(&|t| t * t));
            let moment = |of: &dyn Fn(f64) -> f64| {
                samples.iter().zip(&weights).map(|(it, w)| it.1 * (w * of(it.0))).sum::<Vector3<f64>>()
            };
            let (by_one, by_t) = (moment(&|_| 1.0), moment(&|t| t));
            let determinant = one * tt - t * t;
            p_W = (by_one * tt - by_t * t) / determinant;
            v_W = (by_t * one - by_one * t) / determinant;
            // Least absolute deviations, over standard deviations.
            weights = samples
                .iter()
                .map(|(t, q, sd)| ((q - p_W - v_W * *t).norm() / sd).max(0.1).recip() / (sd * sd))
                .collect();
        }
        Some(Self { seen, epoch_s, p_W, v_W, drag_per_m: 0.0, offsets: vec![Vector3::zeros(); cameras.len()] })
    }

    /// Residuals and derivatives of all sightings.
    pub fn rows(&self, cameras: &[CameraState], tilt_rad: [f64; 2]) -> Vec<Row> {
        let law = law(self.drag_per_m, tilt_rad);
        let start = (0.0, Motion::new(self.p_W, self.v_W));
        let mut rows = Vec::with_capacity(self.seen.len());
        let (mut before, mut after) = (start, start);
        let middle = self.seen.len() / 2;
        for it in self.seen[..middle].iter().rev().chain(&self.seen[middle..]) {
            let camera = &cameras[it.sighting.camera];
            let time_s = it.sighting.capture_s + camera.time_offset_s - self.epoch_s;
            let reached = if time_s < 0.0 { &mut before } else { &mut after };
            *reached = (time_s, reached.1.after(time_s - reached.0, &law, true));
            rows.push(self.row(it, camera, &reached.1));
        }
        rows
    }

    /// The sighting (1 + s)·q + b with q = X_CW·p(t) and the registration's offset b. A camera that moves by
    /// exp(ω, v) sees q + q × ω − v.
    fn row(&self, it: &Seen, camera: &CameraState, motion: &Motion<6>) -> Row {
        let q = camera.X_WC.inverse_transform_point(&motion.p.into()).coords;
        let scale = 1.0 + camera.depth_scale;
        let R_CW = camera.X_WC.rotation.inverse().to_rotation_matrix();
        let columns = it.offset_columns();
        let at = it.sighting.camera;
        let residual = it.sighting.p_C - q * scale - columns * (camera.offset + self.offsets[at]);
        let by_p = it.whitening * R_CW.matrix() * scale;
        let mut by_common = SMatrix::<f64, 3, { OF_CAMERA + OF_TILT }>::zeros();
        by_common.fixed_columns_mut::<3>(0).copy_from(&(it.whitening * q.cross_matrix() * scale));
        by_common.fixed_columns_mut::<3>(3).copy_from(&(it.whitening * -scale));
        by_common.set_column(6, &(it.whitening * q));
        by_common.set_column(7, &(by_p * motion.v));
        by_common.fixed_columns_mut::<OF_OFFSET>(CAMERA_PARAMETERS).copy_from(&(it.whitening * columns));
        by_common.fixed_columns_mut::<OF_TILT>(OF_CAMERA).copy_from(&(by_p * motion.dp.fixed_columns::<2>(4)));
        let mut by_own = SMatrix::<f64, 3, { OF_FLIGHT + OF_OFFSET }>::zeros();
        by_own.fixed_columns_mut::<3>(0).copy_from(&by_p);
        by_own.fixed_columns_mut::<4>(3).copy_from(&(by_p * motion.dp.fixed_columns::<4>(0)));
        by_own.fixed_columns_mut::<OF_OFFSET>(OF_FLIGHT).copy_from(&(it.whitening * columns));
        Row { camera: at, residual: it.whitening * residual, by_common, by_own }
    }

    /// The equations of this flight, sightings as uncertain as they say times the root of `factor`.
    pub fn equations(&self, cameras: &[CameraState], tilt_rad: [f64; 2], factor: f64) -> Option<FlightEquations> {
        let common = OF_CAMERA * cameras.len() + OF_TILT;
        let own = OF_FLIGHT + OF_OFFSET * cameras.len();
        let (mut information, mut pull) = (DMatrix::zeros(common, common), DVector::zeros(common));
        let (mut own_information, mut own_pull) = (DMatrix::<f64>::zeros(own, own), DVector::zeros(own));
        let mut coupling = DMatrix::zeros(common, own);
        let mut outliers = 0;
        for row in self.rows(cameras, tilt_rad) {
            let size = row.residual.norm() / factor.sqrt();
            if size > OUTLIER_SD {
                outliers += 1;
                continue;
            }
            let weight = (HUBER_SD / size).min(1.0) / factor;
            let Row { by_common, by_own, .. } = row;
            let place =
                |i: usize| if i < OF_CAMERA { OF_CAMERA * row.camera + i } else { common - OF_TILT + i - OF_CAMERA };
            let own_place = |i: usize| if i < OF_FLIGHT { i } else { OF_OFFSET * row.camera + i };
            add(&mut information, &(by_common.tr_mul(&by_common) * weight), place, place);
            add(&mut coupling, &(by_common.tr_mul(&by_own) * weight), place, own_place);
            add(&mut own_information, &(by_own.tr_mul(&by_own) * weight), own_place, own_place);
            let (by, own_by) = (by_common.tr_mul(&row.residual) * weight, by_own.tr_mul(&row.residual) * weight);
            by.iter().enumerate().for_each(|(i, value)| pull[place(i)] += value);
            own_by.iter().enumerate().for_each(|(i, value)| own_pull[own_place(i)] += value);
        }
        let mut prior = |at: usize, value: f64, sd: f64| {
            own_information[(at, at)] += inverse_variance(sd);
            own_pull[at] -= value * inverse_variance(sd);
        };
        prior(DRAG, self.drag_per_m, DRAG_SD_PER_M);
        for (i, offset) in self.offsets.iter().enumerate() {
            for (axis, (value, sd)) in offset.iter().zip(FLIGHT_OFFSET_SD_M).enumerate() {
                prior(OF_FLIGHT + OF_OFFSET * i + axis, *value, sd);
            }
        }
        let own = own_information.cholesky()?;
        information -= &coupling * own.solve(&coupling.transpose());
        pull -= &coupling * own.solve(&own_pull);
        Some(FlightEquations { information, pull, outliers, own, own_pull, coupling })
    }

    /// The flight with one of its parameters changed.
    #[cfg(test)]
    pub fn changed(&self, parameter: usize, by: f64) -> Self {
        let mut changed = self.clone();
        match parameter {
            0..3 => changed.p_W[parameter] += by,
            3..DRAG => changed.v_W[parameter - 3] += by,
            _ => changed.drag_per_m += by,
        }
        changed
    }

    /// Takes the step that goes with one of what is estimated in common.
    pub fn step(&mut self, equations: &FlightEquations, change: &DVector<f64>) {
        let own = equations.own.solve(&(&equations.own_pull - equations.coupling.tr_mul(change)));
        self.p_W += own.fixed_rows::<3>(0);
        self.v_W += own.fixed_rows::<3>(3);
        self.drag_per_m += own[DRAG];
        for (i, offset) in self.offsets.iter_mut().enumerate() {
            *offset += own.fixed_rows::<OF_OFFSET>(OF_FLIGHT + OF_OFFSET * i);
        }
    }
}

/// Adds a small matrix to a large one at the places of its rows and columns.
fn add<const R: usize, const C: usize>(
    all: &mut DMatrix<f64>,
    part: &SMatrix<f64, R, C>,
    row: impl Fn(usize) -> usize,
    column: impl Fn(usize) -> usize,
) {
    for (i, j) in (0..C).flat_map(|j| (0..R).map(move |i| (i, j))) {
        all[(row(i), column(j))] += part[(i, j)];
    }
}
