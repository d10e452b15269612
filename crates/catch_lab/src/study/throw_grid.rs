//! Throws from a grid of distances and speeds at one place: does a method miss because of speed?
//!
//! The paper supposes so (IV-C). The place is where a given throw comes nearest to the axis of the arm's
//! base, the direction that in which it comes there. What is thrown from farther away or faster is thrown the
//! same way otherwise.

use catch_body::statistics::median;
use catch_body::{InputError, dynamics::gravity};
use catch_sim::Throw;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::{
    evaluation::{Row, cell_summary::CellSummary},
    scenario::setup::Setup,
};

/// Grid of throws: distances and speeds of the release.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThrowGrid {
    /// Distances from the axis of the base, in metres.
    pub distances_m: Vec<f64>,
    /// Speeds at release, in m/s.
    pub speeds_mps: Vec<f64>,
}

/// One distance and speed.
#[derive(Debug, Clone, Serialize)]
pub struct GridPoint {
    /// Summary of its throws.
    #[serde(flatten)]
    pub summary: CellSummary,
    /// Median over throws of the distance of the undisturbed object at the catch from its planned position in
    /// the gripper.
    pub median_grasp_offset_m: Option<f64>,
}

/// Height of release, in metres: that of a hand, from where 1 m can be thrown at 2 m/s.
const RELEASE_M: f64 = 1.2;
/// The place is sought up to this time after the release, in seconds, in such steps.
const FLIGHT_S: f64 = 2.0;
const STEP_S: f64 = 1e-3;
/// Lowest height of that place, in metres.
const LEAST_HEIGHT_M: f64 = 0.3;

/// Returns the name of a throw of the grid in results.
fn name(distance_m: f64, speed_mps: f64) -> String {
    format!("{distance_m}m_{speed_mps}mps")
}

impl ThrowGrid {
    /// Checks that there are distances and speeds.
    ///
    /// # Errors
    /// A list without a value, or with one that is out of range; `file` names the study.
    pub fn check(&self, file: &str) -> Result<(), InputError> {
        for (field, values) in [("distances_m", &self.distances_m), ("speeds_mps", &self.speeds_mps)] {
            let is_right = !values.is_empty() && values.iter().all(|value| (0.1..=100.0).contains(value));
            if !is_right {
                let found = format!("{values:?}");
                return Err(InputError::new(
                    file,
                    format!("throw_grid.{field}"),
                    found,
                    "one number or more from 0.1 to 100",
                ));
            }
        }
        Ok(())
    }

    /// The throws, made after that of `setup`, with what results call them. Where an arc at that speed does
    /// not get to the place there is none.
    pub fn throws(&self, setup: &Setup) -> impl Iterator<Item = (String, Throw)> {
        let points =
            self.distances_m.iter().flat_map(|distance| self.speeds_mps.iter().map(move |speed| (*distance, *speed)));
        points.filter_map(|(distance_m, speed_mps)| {
            Some((name(distance_m, speed_mps), throw(setup, distance_m, speed_mps)?))
        })
    }

    /// Summarizes the throws of an object: row by row of the distances, one entry per speed.
    pub fn summarize(&self, object: &str, rows: &[&Row], throw_is_fixed: bool) -> Vec<Vec<Option<GridPoint>>> {
        let point = |distance_m: f64, speed_mps: f64| {
            let name = name(distance_m, speed_mps);
            let rows: Vec<&Row> = rows.iter().copied().filter(|row| row.scene.throw == name).collect();
            let offsets = rows.iter().filter_map(|row| row.verdict.measures.grasp_offset_m).collect();
            let summary = CellSummary::of(object, &name, &rows, throw_is_fixed);
            (!rows.is_empty()).then(|| GridPoint { summary, median_grasp_offset_m: median(offsets) })
        };
        let row = |distance: &f64| self.speeds_mps.iter().map(|speed| point(*distance, *speed)).collect();
        self.distances_m.iter().map(row).collect()
    }
}

/// The throw from `distance_m` away at `speed_mps`, on the flatter of the two arcs; `None` if it does not get
/// there.
fn throw(setup: &Setup, distance_m: f64, speed_mps: f64) -> Option<Throw> {
    let like = setup.release(0, 0);
    let base = setup.robot.X_WB.translation.vector;
    let (place, direction) = nearest(&like.p_WO, &like.v_WO, &base)?;
    let (p_WO, v_WO) = aimed(&place, &direction, &base, distance_m, speed_mps)?;
    Some(setup.throw.moved(&p_WO, &v_WO))
}

/// Finds the point at which a throw is nearest to a vertical axis through `base`, and its horizontal
/// direction there.
fn nearest(p: &Point3<f64>, v: &Vector3<f64>, base: &Vector3<f64>) -> Option<(Point3<f64>, Vector3<f64>)> {
    let at = |time_s: f64| p + v * time_s + gravity() * (0.5 * time_s * time_s);
    let steps = (FLIGHT_S / STEP_S) as usize;
    let places = (0..=steps).map(|i| at(i as f64 * STEP_S)).filter(|place| place.z >= LEAST_HEIGHT_M);
    let far = |place: &Point3<f64>| (place.coords - base).xy().norm();
    let place = places.min_by(|a, b| far(a).total_cmp(&far(b)))?;
    Some((place, Vector3::new(v.x, v.y, 0.0).try_normalize(1e-6)?))
}

/// Release point and velocity of a throw to `place`.
///
/// With L the horizontal and h the vertical way, tan θ = (v² − √(v⁴ − g·(g·L² + 2·h·v²)))/(g·L) is the
/// flatter arc.
fn aimed(
    place: &Point3<f64>,
    direction: &Vector3<f64>,
    base: &Vector3<f64>,
    distance_m: f64,
    speed_mps: f64,
) -> Option<(Point3<f64>, Vector3<f64>)> {
    // |place − base − L·direction| = distance, the larger L.
    let offset = Vector3::new(place.x - base.x, place.y - base.y, 0.0);
    let along = offset.dot(direction);
    let rest = along * along - offset.norm_squared() + distance_m * distance_m;
    let L = along + Some(rest).filter(|rest| *rest >= 0.0)?.sqrt();
    if L <= 0.0 {
        return None;
    }
    let (g, h, v2) = (gravity().norm(), place.z - RELEASE_M, speed_mps * speed_mps);
    let root = v2 * v2 - g * (g * L * L + 2.0 * h * v2);
    let angle = libm::atan((v2 - Some(root).filter(|root| *root >= 0.0)?.sqrt()) / (g * L));
    let from = place - direction * L;
    let p_WO = Point3::new(from.x, from.y, RELEASE_M);
    Some((p_WO, direction * (speed_mps * libm::cos(angle)) + Vector3::z() * (speed_mps * libm::sin(angle))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_throw_of_the_grid_goes_through_the_same_place() {
        let (place, base) = (Point3::new(0.55, -0.25, 0.55), Vector3::new(0.1, 0.0, 0.0));
        let direction = Vector3::new(-0.5, -0.8, 0.0).normalize();
        let mut reached = 0;
        for distance_m in [1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0] {
            for speed_mps in [2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0] {
                let Some((p, v)) = aimed(&place, &direction, &base, distance_m, speed_mps) else { continue };
                reached += 1;
                assert!(((p.coords - base).xy().norm() - distance_m).abs() < 1e-9);
                assert!((v.norm() - speed_mps).abs() < 1e-9);
                let time_s = (place - p).xy().norm() / v.xy().norm();
                let there = p + v * time_s + gravity() * (0.5 * time_s * time_s);
                assert!((there - place).norm() < 1e-9, "{distance_m} m, {speed_mps} m/s");
            }
        }
        // The slowest do not get far.
        assert!((30..49).contains(&reached), "{reached}");
        assert!(aimed(&place, &direction, &base, 1.0, 2.0).is_some());
        assert!(aimed(&place, &direction, &base, 4.0, 2.0).is_none());
    }

    #[test]
    fn a_throw_is_nearest_where_it_passes() {
        let from = Point3::new(2.0, 0.6, 1.0);
        let (place, direction) = nearest(&from, &Vector3::new(-4.0, 0.0, 2.0), &Vector3::zeros()).unwrap();
        assert!((place.x.abs() < 4e-3) && (place.y - 0.6).abs() < 1e-12 && direction.x == -1.0);
    }
}
