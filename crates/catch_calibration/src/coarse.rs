//! Coarse alignment: points of the images to the nearest surface of the arm, with gates that close, from
//! several starts.

use catch_body::{
    Gripper, Pose, Robot,
    kinematics::LinkPoses,
    shape::{Capsule, Cuboid},
};
use catch_cell::{CameraModel, PixelWindow};
use nalgebra::{Matrix6, Point2, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::{AveragedImage, averaged_image::StillImage};

/// Starts, the first guess among them.
const STARTS: usize = 10;
/// Largest errors of the first guess along each axis, in metres, and about each axis, in radians: 5°.
const GUESS_M: f64 = 0.05;
const GUESS_RAD: f64 = 5.0_f64.to_radians();
/// Distances from the arm beyond which a point counts for little, one after the other, in metres.
const GATES_M: [f64; 7] = [0.3, 0.2, 0.13, 0.09, 0.06, 0.04, 0.025];
/// Steps with each.
const STEPS: usize = 4;
/// Points of each image.
const POINTS: usize = 150;

/// The arm's surface in W at one time, and what an image shows then, in C.
pub struct PosedPoints {
    capsules: Vec<Capsule>,
    boxes: Vec<(Pose, Cuboid)>,
    points_C: Vec<Point3<f64>>,
}

impl PosedPoints {
    /// Points of an image that do not stand still, while the links are at `X_WL` and the gripper is `width_m`
    /// wide.
    pub fn new(
        (robot, gripper): (&Robot, &Gripper),
        (X_WL, width_m): (&LinkPoses, f64),
        camera: &CameraModel,
        (image, still): (&AveragedImage, &StillImage),
    ) -> Self {
        let capsules = robot.capsules.iter().map(|(link, capsule)| capsule.transformed(&X_WL[*link])).collect();
        let X_WG = robot.gripper_in(X_WL);
        let [left, right] = gripper.fingers(width_m);
        let boxes = [gripper.body(), left, right].map(|it| (X_WG, it)).to_vec();
        let PixelWindow { left, top, width, height } = image.window;
        let pixels = (top..top + height).flat_map(|row| (left..left + width).map(move |column| [column, row]));
        let moving = pixels.filter_map(|it| {
            let [column, row] = it.map(|at| at as usize);
            let (inverse_m, shown) = image.at(column, row);
            let moves = shown > 0 && !still.shows([column, row], inverse_m);
            moves.then(|| (it.map(|at| f64::from(at) + 0.5), inverse_m))
        });
        let moving: Vec<([f64; 2], f32)> = moving.collect();
        let spacing = (moving.len() / POINTS).max(1);
        let point =
            |(uv, inverse_m): &([f64; 2], f32)| camera.back_project(&Point2::from(*uv), 1.0 / f64::from(*inverse_m));
        let points_C = moving.iter().step_by(spacing | 1).map(point).collect();
        Self { capsules, boxes, points_C }
    }

    /// Distance of a point in W from the arm's surface, negative inside, and the direction away from it.
    fn distance(&self, p_W: &Point3<f64>) -> (f64, Vector3<f64>) {
        let of_capsules = self.capsules.iter().map(|it| away_from_capsule(it, p_W));
        let of_boxes = self.boxes.iter().map(|(X_WG, cuboid)| {
            let (distance_m, away_G) = away_from_cuboid(cuboid, &X_WG.inverse_transform_point(p_W));
            (distance_m, X_WG.rotation * away_G)
        });
        let nothing = (f64::INFINITY, Vector3::zeros());
        of_capsules.chain(of_boxes).fold(nothing, |nearest, it| if it.0 < nearest.0 { it } else { nearest })
    }
}

fn away_from_capsule(capsule: &Capsule, p: &Point3<f64>) -> (f64, Vector3<f64>) {
    let away = capsule.from_axis(p);
    (away.norm() - capsule.radius, away.try_normalize(1e-9).unwrap_or_default())
}

fn away_from_cuboid(cuboid: &Cuboid, p: &Point3<f64>) -> (f64, Vector3<f64>) {
    let (offset, half) = (p - cuboid.centre, cuboid.size / 2.0);
    let outside = offset.zip_map(&half, |x, h| x - x.clamp(-h, h));
    match outside.try_normalize(1e-9) {
        Some(away) => (outside.norm(), away),
        None => {
            let depth = offset.abs() - half;
            let axis = depth.imax();
            (depth[axis], Vector3::ith(axis, offset[axis].signum()))
        }
    }
}

/// The pose of a camera that fits best among several starts around `X_WC`.
pub fn align(images: &[PosedPoints], X_WC: &Pose, seed: u64) -> Pose {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut best: Option<(f64, Pose)> = None;
    for start in 0..STARTS {
        let mut draw = |size: f64| Vector3::from_fn(|_, _| random.random_range(-size..=size));
        let (p, turn) = (draw(GUESS_M), draw(GUESS_RAD));
        let offset = if start == 0 { Pose::identity() } else { moved(&p, &turn) };
        let mut X_WC = X_WC * offset;
        for gate_m in GATES_M {
            for _ in 0..STEPS {
                step(images, &mut X_WC, gate_m);
            }
        }
        let cost = cost(images, &X_WC);
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, X_WC));
        }
    }
    best.map_or(*X_WC, |(_, X_WC)| X_WC)
}

/// A pose of a small rotation and translation.
pub fn moved(p: &Vector3<f64>, turn: &Vector3<f64>) -> Pose {
    Pose::from_parts(Translation3::from(*p), UnitQuaternion::from_scaled_axis(*turn))
}

/// Moves the camera by one Gauss–Newton step on Geman–McClure's loss.
fn step(images: &[PosedPoints], X_WC: &mut Pose, gate_m: f64) {
    let (mut information, mut pull) = (Matrix6::identity() * 1e-6, Vector6::zeros());
    for image in images {
        for p_C in &image.points_C {
            let (distance_m, away_W) = image.distance(&(*X_WC * p_C));
            if !distance_m.is_finite() {
                continue;
            }
            let weight = (1.0 + (distance_m / gate_m).powi(2)).powi(-2);
            // With X_WC·exp(ω, v) a point of C moves by ω × p + v.
            let away_C = X_WC.rotation.inverse() * away_W;
            let turning = p_C.coords.cross(&away_C);
            let row = Vector6::new(turning.x, turning.y, turning.z, away_C.x, away_C.y, away_C.z);
            information += row * row.transpose() * weight;
            pull -= row * (distance_m * weight);
        }
    }
    if let Some(factor) = information.cholesky() {
        let by = factor.solve(&pull);
        *X_WC *= moved(&by.fixed_rows::<3>(3).into(), &by.fixed_rows::<3>(0).into());
    }
}

fn cost(images: &[PosedPoints], X_WC: &Pose) -> f64 {
    let gate_m = GATES_M[GATES_M.len() - 1];
    let points = images.iter().flat_map(|image| image.points_C.iter().map(move |p_C| (image, p_C)));
    points.map(|(image, p_C)| image.distance(&(X_WC * p_C)).0.abs().min(gate_m).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_outside_or_inside_and_directions_lead_away() {
        let capsule = Capsule { from: Point3::origin(), to: Point3::new(0.0, 0.0, 1.0), radius: 0.1 };
        let cuboid = Cuboid { centre: Point3::new(0.0, 0.0, 0.5), size: Vector3::new(0.2, 0.2, 1.0) };
        let step = 1e-6;
        for p in [Point3::new(0.3, 0.12, 0.4), Point3::new(0.02, 0.07, 0.6), Point3::new(0.12, 0.2, 1.4)] {
            let of = |p: &Point3<f64>| [away_from_capsule(&capsule, p), away_from_cuboid(&cuboid, p)];
            for (shape, (_, away)) in of(&p).into_iter().enumerate() {
                let along = |axis: usize| {
                    let [after, before] = [step, -step].map(|by| of(&(p + Vector3::ith(axis, by)))[shape].0);
                    (after - before) / (2.0 * step)
                };
                assert!((Vector3::new(along(0), along(1), along(2)) - away).norm() < 1e-6);
            }
        }
        assert!(away_from_capsule(&capsule, &Point3::new(0.02, 0.0, 0.5)).0 < 0.0);
    }
}
