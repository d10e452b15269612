//! A point mass under gravity and quadratic drag, and how its motion depends on where it begins.

use catch_body::dynamics;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// Longest step of the integration.
const STEP_S: f64 = 0.02;
/// Greatest number of steps, so that absurd times cost no more than wrong answers.
const MOST_STEPS: f64 = 500.0;

/// Derivatives by velocity at the start, drag constant, and tilt about x and y of W.
pub type Derivatives = SMatrix<f64, 3, 6>;

/// The law of motion v̇ = g + θ × g − k·|v|·v.
#[derive(Debug, Clone, Copy)]
pub struct Law {
    pub drag_per_m: f64,
    /// Rotation about x and y of W by which the vertical is off.
    pub tilt_rad: [f64; 2],
}

impl Law {
    fn gravity(&self) -> Vector3<f64> {
        let [x, y] = self.tilt_rad;
        dynamics::gravity() + Vector3::new(x, y, 0.0).cross(&dynamics::gravity())
    }
}

/// Position and velocity in W, and their derivatives; ∂p/∂p₀ is the identity and ∂v/∂p₀ zero.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    pub p: Vector3<f64>,
    pub v: Vector3<f64>,
    pub dp: Derivatives,
    pub dv: Derivatives,
}

impl Motion {
    pub fn new(p: Vector3<f64>, v: Vector3<f64>) -> Self {
        let mut dv = Derivatives::zeros();
        dv.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        Self { p, v, dp: Derivatives::zeros(), dv }
    }

    /// The motion so much later, or earlier: Runge–Kutta of fourth order, the derivatives together with the
    /// state.
    pub fn after(&self, duration_s: f64, law: &Law) -> Self {
        let steps = (duration_s.abs() / STEP_S).ceil().min(MOST_STEPS);
        let h = duration_s / steps.max(1.0);
        let mut motion = *self;
        for _ in 0..steps as usize {
            let k1 = motion.rate(law);
            let k2 = motion.plus(&k1, h / 2.0).rate(law);
            let k3 = motion.plus(&k2, h / 2.0).rate(law);
            let k4 = motion.plus(&k3, h).rate(law);
            motion = motion.plus(&k1, h / 6.0).plus(&k2, h / 3.0).plus(&k3, h / 3.0).plus(&k4, h / 6.0);
        }
        motion
    }

    /// d/dt ∂p = ∂v, and d/dt ∂v = A·∂v + [0 | −|v|v | eₓ × g | e_y × g] with A = −k·(|v|·1 + v·vᵀ/|v|).
    fn rate(&self, law: &Law) -> Self {
        let speed = self.v.norm();
        let along = if speed > 1e-9 { self.v * self.v.transpose() / speed } else { Matrix3::zeros() };
        let mut dv = (Matrix3::identity() * speed + along) * -law.drag_per_m * self.dv;
        let by = [-self.v * speed, Vector3::x().cross(&dynamics::gravity()), Vector3::y().cross(&dynamics::gravity())];
        for (i, by) in by.iter().enumerate() {
            let mut column = dv.column_mut(3 + i);
            column += by;
        }
        Self { p: self.v, v: law.gravity() - self.v * (law.drag_per_m * speed), dp: self.dv, dv }
    }

    fn plus(&self, rate: &Self, h: f64) -> Self {
        Self { p: self.p + rate.p * h, v: self.v + rate.v * h, dp: self.dp + rate.dp * h, dv: self.dv + rate.dv * h }
    }
}
