//! Prior on an object's flights.

use std::path::Path;

use catch_body::{
    InputError,
    free_flight::{DECAY, DRAG, INERTIA, LIFT, MAGNUS, PARAMETERS, POINT, ParameterVector},
    quantity,
};
use catch_recording::bounded_file::FileKind;
use nalgebra::{DMatrix, SMatrix};
use serde::{Deserialize, Serialize};

/// Covariance of the parameters.
pub type ParameterCovariance = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// Prior on an object's flights: mean and covariance of 19 parameters, and noise.
///
/// The 19 parameters are in SI units, in this order. The tracked point from the centre of mass is in the body
/// frame: x, y, z (m). The symmetric matrix M in the body frame, whose exponential is the drag matrix D of a
/// = −|v|·D·v: xx, yy, zz, xy, xz, yz (logarithm of 1/m). Then come the Magnus coefficient k of a = k·ω×v and
/// the decay c of the spin in ω̇ = −c·ω (1/s). Five are those of the traceless matrix S, whose exponential is
/// the inertia tensor: xx, yy, xy, xz, yz. The last are the vector s of a = s×v in the world (1/s): the
/// Magnus force in a track without orientations.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlightPrior {
    /// Source of the numbers.
    pub source: String,
    /// Throws that they were learned from.
    pub throws: usize,
    /// Noise density of the acceleration, in m/s²/√Hz.
    pub acceleration_noise: quantity::noise_density,
    /// Noise density of the angular acceleration, in rad/s²/√Hz.
    pub angular_acceleration_noise: quantity::noise_density,
    /// Error in metres that neighbouring samples have in common, so that no number of them reduces it; part
    /// of every prediction.
    pub systematic_sd_m: quantity::error_m,
    /// Least noise of a sample that is believed, however well the samples agree with each other.
    pub least_noise: Noise,
    /// Mean of the parameters.
    pub mean: [f64; PARAMETERS],
    /// Covariance of the parameters, row by row.
    pub covariance: [[f64; PARAMETERS]; PARAMETERS],
}

/// Standard deviations of a track's samples along and about each axis.
#[quantity::checked]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Standard deviation of the position, in metres.
    pub position_sd_m: quantity::error_m,
    /// Standard deviation of the orientation, in radians.
    pub orientation_sd_rad: quantity::error_rad,
}

/// First of the parameters of the drag, and of those of the lift, among the parameters.
pub(super) const DRAG_AT: usize = DRAG - POINT;
/// See [`DRAG_AT`].
pub(super) const LIFT_AT: usize = LIFT - POINT;

impl FlightPrior {
    /// Mean of the parameters.
    pub fn mean(&self) -> ParameterVector {
        ParameterVector::from(self.mean)
    }

    /// Covariance of the parameters.
    pub fn covariance(&self) -> ParameterCovariance {
        ParameterCovariance::from_fn(|i, j| self.covariance[i][j])
    }

    /// Returns this prior with other moments of the parameters.
    pub fn with_moments(&self, mean: &ParameterVector, covariance: &ParameterCovariance) -> Self {
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)]));
        Self { mean: (*mean).into(), covariance: rows, ..self.clone() }
    }

    /// Moments of the parameters as a track with or without orientations has them.
    ///
    /// Without them the tracked point cannot be told from the centre of mass, and of the drag only what is
    /// left on average over all orientations: a third of the matrix's trace along each axis. With them the
    /// Magnus force is that of the measured spin.
    pub(super) fn moments(&self, oriented: bool) -> (ParameterVector, ParameterCovariance) {
        let (mut mean, mut covariance) = (self.mean(), self.covariance());
        if oriented {
            mean.fixed_rows_mut::<3>(LIFT_AT).fill(0.0);
            covariance.fixed_rows_mut::<3>(LIFT_AT).fill(0.0);
            covariance.fixed_columns_mut::<3>(LIFT_AT).fill(0.0);
            return (mean, covariance);
        }
        let (mut isotropic, mut shared) = (ParameterVector::zeros(), ParameterCovariance::zeros());
        isotropic.fixed_rows_mut::<3>(DRAG_AT).fill(mean.fixed_rows::<3>(DRAG_AT).mean());
        let variance = covariance.fixed_view::<3, 3>(DRAG_AT, DRAG_AT).sum() / 9.0;
        shared.fixed_view_mut::<3, 3>(DRAG_AT, DRAG_AT).fill(variance);
        isotropic.fixed_rows_mut::<3>(LIFT_AT).copy_from(&mean.fixed_rows::<3>(LIFT_AT));
        let lift = covariance.fixed_view::<3, 3>(LIFT_AT, LIFT_AT).into_owned();
        shared.fixed_view_mut::<3, 3>(LIFT_AT, LIFT_AT).copy_from(&lift);
        (isotropic, shared)
    }

    /// The mean of the parameters, and a matrix B with which they are mean + B·z, z of unit covariance.
    pub(super) fn whitened(&self, oriented: bool) -> (ParameterVector, DMatrix<f64>) {
        let (mean, covariance) = self.moments(oriented);
        let eigen = covariance.symmetric_eigen();
        let columns: Vec<ParameterVector> = (0..PARAMETERS)
            .filter(|&i| eigen.eigenvalues[i] > 1e-12)
            .map(|i| eigen.eigenvectors.column(i) * eigen.eigenvalues[i].sqrt())
            .collect();
        let basis = DMatrix::from_fn(PARAMETERS, columns.len(), |i, j| columns[j][i]);
        (mean, basis)
    }

    /// Creates a prior with independent parameters: the mean and standard deviation of the drag's logarithm
    /// in all directions, its difference between them, and the standard deviation of the lift.
    fn of_hand_size(source: &str, [drag, drag_sd, by_direction]: [f64; 3], lift_sd: f64) -> Self {
        let (mut mean, mut covariance) = (ParameterVector::zeros(), ParameterCovariance::zeros());
        let mut fill = |first: usize, count: usize, sd: f64| {
            (first - POINT..first - POINT + count).for_each(|i| covariance[(i, i)] = sd * sd);
        };
        fill(POINT, 3, 0.02);
        fill(DRAG + 3, 3, 0.7 * by_direction);
        fill(MAGNUS, 1, 0.01);
        fill(DECAY, 1, 0.3);
        fill(INERTIA, 5, 0.7);
        fill(LIFT, 3, lift_sd);
        for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
            let own = if i == j { 2.0 / 3.0 } else { -1.0 / 3.0 };
            covariance[(DRAG_AT + i, DRAG_AT + j)] = drag_sd * drag_sd + by_direction * by_direction * own;
        }
        mean.fixed_rows_mut::<3>(DRAG_AT).fill(drag);
        mean[DECAY - POINT] = 0.1;
        let empty = Self {
            source: source.into(),
            throws: 0,
            acceleration_noise: 0.1,
            angular_acceleration_noise: 0.5,
            systematic_sd_m: 2e-3,
            least_noise: Noise { position_sd_m: 3e-4, orientation_sd_rad: 2e-3 },
            mean: [0.0; PARAMETERS],
            covariance: [[0.0; PARAMETERS]; PARAMETERS],
        };
        empty.with_moments(&mean, &covariance)
    }

    /// Prior to begin learning with: any object of a hand's size.
    pub fn broad() -> Self {
        Self::of_hand_size("any object of a hand's size", [-2.8, 1.2, 0.5], 1.5)
    }

    /// The built-in prior for tumbling objects whose orientation is tracked.
    pub fn any_object() -> Self {
        toml::from_str(ANY_OBJECT).unwrap_or_else(|_| Self::broad())
    }

    /// The built-in priors for tracks of positions: everyday objects between a baseball and a foam ball, of
    /// which the evidence of the track chooses one. They spin hardly or fast, and are balls or have a tracked
    /// point that tumbles with them.
    pub fn any_points() -> Vec<Self> {
        let of = |[lift_sd, acceleration_noise]: [f64; 2]| {
            let prior = Self::of_hand_size("everyday objects without orientation", [-3.2, 1.1, 0.0], lift_sd);
            let least_noise = Noise { position_sd_m: 1e-4, ..prior.least_noise };
            Self { acceleration_noise, systematic_sd_m: 5e-4, least_noise, ..prior }
        };
        [[0.03, 0.004], [0.2, 0.004], [1.5, 0.004], [0.1, 0.5]].map(of).to_vec()
    }

    /// Reads what was learned of an object.
    ///
    /// # Errors
    /// A file that cannot be read, or numbers that are no prior.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let file = path.display().to_string();
        let expected = "a file that `catchingbot learn` has written";
        let text = FileKind::toml(expected).read_text(path)?;
        let prior: Self = InputError::parse_toml(&file, &text)
            .map_err(|fault| InputError { expected: format!("{}, as in {expected}", fault.expected), ..fault })?;
        prior.check(&file)?;
        Ok(prior)
    }

    /// Checks that the prior can be used; `file` is its name in errors.
    ///
    /// # Errors
    /// A covariance that is none.
    pub fn check(&self, file: &str) -> Result<(), InputError> {
        let covariance = self.covariance();
        let is_covariance = (covariance - covariance.transpose()).amax() <= 1e-9 * covariance.amax()
            && (covariance + ParameterCovariance::identity() * 1e-12).cholesky().is_some();
        let expected = "a matrix that is symmetric and positive definite";
        if is_covariance { Ok(()) } else { Err(InputError::new(file, "covariance", "another matrix", expected)) }
    }

    /// Text of a file for [`read`](Self::read).
    ///
    /// # Errors
    /// Never, for numbers that are finite.
    pub fn text(&self) -> Result<String, toml::ser::Error> {
        Ok(format!("{HEADER}{}", toml::to_string(self)?))
    }
}

const HEADER: &str = "\
# Flights of an object, for `catchingbot predict --object`; written by `catchingbot learn`.
# Parameters in this order: tracked point from the centre of mass in the body frame (x, y, z; m), logarithm of the drag
# matrix (xx, yy, zz, xy, xz, yz; 1/m), Magnus coefficient, decay of the spin (1/s), logarithm of the inertia tensor
# (xx, yy, xy, xz, yz; traceless), lift s of a = s x v in tracks without orientations (x, y, z; 1/s).
";

const ANY_OBJECT: &str = include_str!("../../../../assets/flights/any_object.toml");
