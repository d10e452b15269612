//! Camera placement: poses from which the flight is best determined when the catch is decided.
//!
//! The module has a score of rigs, and a search for the best rig. For each of many throws of a
//! scenario every image until the decision has information about the flight, if it shows the object: neither
//! its border nor the waiting arm hides it. The flight is a parabola with an unknown position and velocity at
//! the catch. Each image adds the information Jᵀ·W·J with J = \[I, (t − t_c)·I\] and W the inverse covariance
//! of a position that one image measures: the data sheet's noise along the optical axis, [`LATERAL_PX`]
//! across it. The covariance of the position at the catch is a block of the inverse of the sum. The catch is
//! where the flight is nearest to the base's axis. Rigs are compared by the standard deviation at two times:
//! when the catch is decided, and when the fingers begin to close.
//!
//! Cameras are calibrated on the arm, so that only those are chosen which show enough of it. The search is
//! greedy and then exchanges cameras as long as that helps (Fedorov, Theory of optimal experiments, 1972).

mod arm_view;
pub mod expected_rate;

use catch_body::{
    InputError, Pose, dynamics,
    pose::look_at,
    quantity,
    ray_cast::ArmSurface,
    statistics::{quantile, sorted},
};
use catch_cell::{CameraModel, DataSheet};
use nalgebra::{Matrix3, Matrix6, Point3, Vector3};
use serde::Serialize;

use crate::scenario::setup::Setup;
use catch_recording::whole_file::COMMAND_LINE;

/// Standard deviation of the centre of an object's image, in pixels: what bleeding edges leave, whatever the
/// number of pixels. Chosen.
pub const LATERAL_PX: f64 = 0.3;
/// Pixels of an object that say something about where it is.
pub const MIN_PIXELS: f64 = 30.0;
/// No image tells where an object is better than this, in metres.
const LEAST_SD_M: f64 = 3e-4;
/// Standard deviations of what is known of a throw before any image, in metres and m/s.
const PRIOR_SD: [f64; 2] = [0.5, 3.0];
/// Longest flight that is looked at, in seconds.
const LONGEST_S: f64 = 1.5;
/// Times from the decision and from the start of finger closing to the catch.
pub const DECISION_S: f64 = 0.3;
/// The latter.
pub const CLOSING_S: f64 = 0.12;
/// Times that each throw is sampled at, at most.
const TICK_S: f64 = 0.01;
/// Quantiles of the flights' times at whose mean places cameras may be aimed.
const AIMS: [f64; 6] = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0];
/// Standard deviations that the free space between object and fingers should hold.
const SURE_SD: f64 = 3.0;
/// Aimed places times throws, at most: of each two matrices are kept, 600 MB in all.
const MOST_TOLD: f64 = 1e6;

/// Settings of a camera placement.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Number of cameras.
    pub cameras: usize,
    /// Throws that are looked at.
    pub throws: u64,
    /// Seed of the throws and of the arm's postures.
    pub seed: u64,
    /// Opposite corners of the volume on whose walls and ceiling cameras may hang, in W.
    pub volume_m: [[f64; 3]; 2],
    /// Distance between neighbouring places on a wall.
    pub spacing_m: f64,
    /// No camera is nearer than this to any flight.
    pub clear_m: f64,
    /// No camera shows less of the arm than this: the fraction of the joints within its image, over random
    /// postures.
    pub arm_fraction: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            cameras: 2,
            throws: 60,
            seed: 1,
            volume_m: [[-1.2, -1.6, 0.4], [2.2, 2.2, 2.2]],
            spacing_m: 0.4,
            clear_m: 0.4,
            arm_fraction: 0.8,
        }
    }
}

/// Score of a rig: visibility of the object and accuracy of the predicted flights.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Score {
    /// Fraction of the instants until the catch at which one camera or more shows the object.
    pub shown_by_one: f64,
    /// Fraction of these instants at which two cameras or more show the object.
    pub shown_by_two: f64,
    /// Fraction of each camera's images until the catch that show it.
    pub shown: Vec<f64>,
    /// Fraction of the arm's joints that each camera shows, over random postures.
    pub arm_shown: Vec<f64>,
    /// Catch rate that is expected of the throws; none where nothing is known of arm, hand and number of
    /// cameras.
    pub expected_rate: Option<f64>,
    /// Accuracy of the prediction of each throw.
    #[serde(skip)]
    pub flights: Vec<FlightScore>,
}

/// What a rig knows of one throw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightScore {
    /// Time before the decision in which two cameras or more show the object, in seconds.
    pub shown_by_two_s: f64,
    /// Expected standard deviation along each axis of the position at the catch that is predicted when it is
    /// decided, in metres.
    pub decision_sd_m: f64,
    /// The same when the fingers begin to close.
    pub closing_sd_m: f64,
}

impl Score {
    /// The deviation that a fraction of the throws does not exceed.
    pub fn quantile_m(&self, sd_m: impl Fn(&FlightScore) -> f64, fraction: f64) -> f64 {
        quantile(&sorted(self.flights.iter().map(sd_m)), fraction).unwrap_or(f64::NAN)
    }

    /// A sentence on what the cameras know of the throws of a setup, and whether it is enough for the free
    /// space between object and fingers.
    pub fn summary(&self, setup: &Setup) -> String {
        if self.shown_by_one == 0.0 {
            return "no camera shows the object on its way to the catch; `catchingbot place-cameras` finds better poses".to_owned();
        }
        let margin_m = setup.scenario.brain.grasp_selection.finger_margin_m;
        let [middle_m, high_m] = [0.5, 0.9].map(|fraction| self.quantile_m(|it| it.decision_sd_m, fraction));
        let known = format!(
            "two cameras or more show the object for {:.0} % of its way to the catch; when the catch is decided, its place there is \
             known to {:.1} mm (90 % of the throws: {:.1} mm)",
            self.shown_by_two * 100.0,
            middle_m * 1e3,
            high_m * 1e3
        );
        let rate = self.expected_rate.map(|it| format!("; {:.0} % are expected to be caught", it * 100.0));
        let known = known + &rate.unwrap_or_default();
        if SURE_SD * high_m <= margin_m {
            return known;
        }
        let too_little =
            format!("{SURE_SD} × {:.1} mm is more than the {:.0} mm on each side of it", high_m * 1e3, margin_m * 1e3);
        let placed = rate_of_placed(setup).filter(|it| Some(*it) > self.expected_rate);
        let rate = placed.map_or("better poses".to_owned(), |it| format!("poses for {:.0} %", it * 100.0));
        format!("{known}; {too_little}; `catchingbot place-cameras` finds {rate}")
    }
}

/// The rate that is expected with as many cameras where `catchingbot place-cameras` puts them; none where it
/// finds no place, or no rate is known.
fn rate_of_placed(setup: &Setup) -> Option<f64> {
    let config = Config { cameras: setup.cameras.len(), ..Config::default() };
    let study = PlacementStudy::new(setup, &config).ok()?;
    let (cameras, _) = study.place(setup.cameras.first()?).ok()?;
    study.score(&cameras).expected_rate
}

/// What some cameras know of the throws of a setup.
///
/// # Errors
/// Throws that are over before the catch would be decided.
pub fn score_of(setup: &Setup, cameras: &[CameraModel]) -> Result<Score, InputError> {
    Ok(PlacementStudy::new(setup, &Config::default())?.score(cameras))
}

/// One throw at the instants until the catch.
#[derive(Debug, Clone)]
pub struct SampledFlight {
    /// Positions of the object every 10 ms from the release on.
    pub p_WO: Vec<Point3<f64>>,
    /// Time of the catch after the release, in seconds.
    pub catch_s: f64,
}

/// Measures rigs on the throws of a scenario.
#[derive(Debug)]
pub struct PlacementStudy<'a> {
    setup: &'a Setup,
    config: &'a Config,
    /// The throws.
    pub flights: Vec<SampledFlight>,
    arm: ArmSurface,
    /// Joint positions in random postures of the arm.
    joints: Vec<Point3<f64>>,
}

impl<'a> PlacementStudy<'a> {
    /// Samples the throws of a scenario.
    ///
    /// # Errors
    /// A volume whose corners are swapped or too large for its spacing, or throws that are over before the
    /// decision.
    pub fn new(setup: &'a Setup, config: &'a Config) -> Result<Self, InputError> {
        let [from, to] = config.volume_m;
        for axis in 0..3 {
            if to[axis] - from[axis] < config.spacing_m || (to[axis] - from[axis]) / config.spacing_m > 100.0 {
                let found = format!("{from:?} to {to:?}");
                let expected = format!("corners of a box whose sides are 1 to 100 times {} m long", config.spacing_m);
                return Err(InputError::new(COMMAND_LINE, "--from and --to", found, expected));
            }
        }
        // The information of each place about each throw is kept.
        let sides = [0, 1, 2].map(|axis| (to[axis] - from[axis]) / config.spacing_m + 1.0);
        let places = 2.0 * (sides[0] + sides[1]) * sides[2] + sides[0] * sides[1];
        let told = places * AIMS.len() as f64 * config.throws as f64;
        if told > MOST_TOLD {
            let found = format!("{} m and {}", config.spacing_m, config.throws);
            let expected = format!("a spacing {:.1} times as large, or fewer throws", (told / MOST_TOLD).sqrt());
            return Err(InputError::new(COMMAND_LINE, "--spacing and --trials", found, expected));
        }
        let flight = |index| {
            let release = setup.release(config.seed, index);
            let at = |time_s: f64| release.p_WO + release.v_WO * time_s + dynamics::gravity() * (time_s * time_s / 2.0);
            let mut p_WO: Vec<Point3<f64>> = Vec::new();
            for tick in 0..(LONGEST_S / TICK_S) as usize {
                let p = at(tick as f64 * TICK_S);
                if p_WO.last().is_some_and(|before| p.coords.xy().norm() > before.coords.xy().norm()) || p.z < 0.0 {
                    break;
                }
                p_WO.push(p);
            }
            SampledFlight { catch_s: p_WO.len().saturating_sub(1) as f64 * TICK_S, p_WO }
        };
        let flights: Vec<SampledFlight> = (0..config.throws).map(flight).collect();
        if let Some(it) = flights.iter().find(|it| it.catch_s <= DECISION_S) {
            let (found, expected) = (format!("{:.2} s in the air", it.catch_s), format!("more than {DECISION_S} s"));
            return Err(InputError::new(COMMAND_LINE, "--throw", found, expected));
        }
        let arm = ArmSurface::new(&setup.robot, &setup.gripper);
        Ok(Self { setup, config, flights, arm, joints: arm_view::joint_places(&setup.robot, config.seed) })
    }

    /// Evaluates a rig: visibility of the object and accuracy of the predictions.
    pub fn score(&self, cameras: &[CameraModel]) -> Score {
        let sights: Vec<Vec<Vec<bool>>> = cameras.iter().map(|camera| self.sight(camera)).collect();
        let (mut instants, mut by_one, mut by_two) = (0, 0, 0);
        for (throw, flight) in self.flights.iter().enumerate() {
            for tick in 0..flight.p_WO.len() {
                let seeing = sights.iter().filter(|it| it[throw][tick]).count();
                instants += 1;
                by_one += usize::from(seeing >= 1);
                by_two += usize::from(seeing >= 2);
            }
        }
        let fraction = |count: usize| count as f64 / f64::from(instants.max(1));
        let deviations = |ahead_s: f64| {
            let told = cameras.iter().zip(&sights);
            let told: Vec<_> = told.map(|(camera, sight)| self.information(camera, sight, ahead_s)).collect();
            move |throw: usize| deviation_m(&told.iter().map(|it| it[throw]).sum())
        };
        let (decision_m, closing_m) = (deviations(DECISION_S), deviations(CLOSING_S));
        let of_throw = |(throw, flight): (usize, &SampledFlight)| {
            let until = ((flight.catch_s - DECISION_S) / TICK_S) as usize;
            let is_seen = |tick: &usize| sights.iter().filter(|it| it[throw][*tick]).count() >= 2;
            FlightScore {
                shown_by_two_s: (0..until).filter(is_seen).count() as f64 * TICK_S,
                decision_sd_m: decision_m(throw),
                closing_sd_m: closing_m(throw),
            }
        };
        let shown = |sight: &Vec<Vec<bool>>| fraction(sight.iter().flatten().filter(|shown| **shown).count());
        let flights: Vec<FlightScore> = self.flights.iter().enumerate().map(of_throw).collect();
        Score {
            shown_by_one: fraction(by_one),
            shown_by_two: fraction(by_two),
            shown: sights.iter().map(shown).collect(),
            arm_shown: cameras.iter().map(|camera| arm_view::shown(camera, &self.joints)).collect(),
            expected_rate: expected_rate::rate(self.setup, cameras.len(), &flights),
            flights,
        }
    }

    /// The best cameras of a kind among those that may hang on walls and ceiling, and the number of places
    /// and aims that they were chosen from.
    ///
    /// # Errors
    /// If there is no place that is clear of all flights and shows enough of the arm.
    pub fn place(&self, kind: &CameraModel) -> Result<(Vec<CameraModel>, usize), InputError> {
        let candidates = self.candidates(kind);
        // Throw by throw at the decision, then at the closing.
        let told = |camera: &CameraModel| {
            let sight = self.sight(camera);
            let at = |ahead_s: f64| self.information(camera, &sight, ahead_s);
            [at(DECISION_S), at(CLOSING_S)].concat()
        };
        let told: Vec<Vec<Matrix6<f64>>> = candidates.iter().map(told).collect();
        if candidates.is_empty() {
            let expected = "a volume with a wall that flights stay clear of and that shows enough of the arm";
            return Err(InputError::new(COMMAND_LINE, "--from, --to and --arm", "no such place", expected));
        }
        // Mean logarithm of the deviations, of which what one camera improves counts as a ratio.
        let cost = |others: &[Matrix6<f64>], candidate: usize| -> f64 {
            others.iter().zip(&told[candidate]).map(|(sum, one)| libm::log(deviation_m(&(sum + one)))).sum()
        };
        let best = |chosen: &[usize]| {
            let none = vec![Matrix6::zeros(); 2 * self.flights.len()];
            let others = chosen.iter().fold(none, |sums, it| sums.iter().zip(&told[*it]).map(|(a, b)| a + b).collect());
            // Two cameras at one place are one mount.
            let is_free = |it: &usize| chosen.iter().all(|other| apart_m(&candidates[*it], &candidates[*other]) > 0.1);
            let costs = (0..candidates.len()).filter(is_free).map(|it| (cost(&others, it), it));
            costs.min_by(|one, two| one.0.total_cmp(&two.0))
        };
        let mut chosen: Vec<usize> = Vec::new();
        let mut least = f64::INFINITY;
        while chosen.len() < self.config.cameras
            && let Some((cost, it)) = best(&chosen)
        {
            (least, chosen) = (cost, [chosen, vec![it]].concat());
        }
        if chosen.len() < self.config.cameras {
            let expected = format!("at most {}, or a larger volume or a smaller --spacing", chosen.len());
            return Err(InputError::new(COMMAND_LINE, "--cameras", self.config.cameras, expected));
        }
        let unseen = vec![Matrix6::zeros(); told[0].len()];
        if chosen.iter().all(|it| told[*it] == unseen) {
            let expected = "a volume from which cameras show it before the fingers close";
            return Err(InputError::new(COMMAND_LINE, "--from and --to", "no camera shows the object", expected));
        }
        let mut unchanged = 0;
        while unchanged < chosen.len() {
            let taken = chosen.remove(0);
            match best(&chosen).filter(|(cost, _)| *cost < least - 1e-9) {
                Some((cost, it)) => {
                    chosen.push(it);
                    (least, unchanged) = (cost, 1);
                }
                None => {
                    chosen.push(taken);
                    unchanged += 1;
                }
            }
        }
        let cameras = chosen.into_iter().map(|it| candidates[it].clone()).collect();
        Ok((cameras, candidates.len()))
    }

    /// Every place on the walls and the ceiling that all flights stay clear of, with every aim that shows
    /// enough of the arm.
    fn candidates(&self, kind: &CameraModel) -> Vec<CameraModel> {
        let [from, to] = self.config.volume_m;
        let steps = |axis: usize| {
            let count = ((to[axis] - from[axis]) / self.config.spacing_m).round().max(1.0) as usize;
            // The last place is the corner itself, whatever rounding says.
            let place = move |i: usize| from[axis] + (to[axis] - from[axis]) * i as f64 / count as f64;
            (0..=count).map(move |i| if i == count { to[axis] } else { place(i) })
        };
        let on_a_wall =
            |p: &Point3<f64>| (0..2).any(|axis| p[axis] == from[axis] || p[axis] == to[axis]) || p.z == to[2];
        let flown = || self.flights.iter().flat_map(|it| &it.p_WO);
        let is_clear = |p: &Point3<f64>| flown().all(|it| (it - p).norm() > self.config.clear_m);
        let aims: Vec<Point3<f64>> = AIMS.iter().map(|fraction| self.mean_place(*fraction)).collect();
        let places = steps(0).flat_map(|x| steps(1).flat_map(move |y| steps(2).map(move |z| Point3::new(x, y, z))));
        let places = places.filter(|p| on_a_wall(p) && is_clear(p));
        let aimed = |p: Point3<f64>| {
            let cameras = aims.iter().filter(move |aim| (*aim - p).norm() > quantity::DISTANCE_M.least);
            cameras.map(move |aim| CameraModel { X_WC: look_at(&p, aim), ..kind.clone() }).collect::<Vec<_>>()
        };
        let shows_arm = |it: &CameraModel| arm_view::shown(it, &self.joints) >= self.config.arm_fraction;
        places.flat_map(aimed).filter(shows_arm).collect()
    }

    /// The mean place of the object after a fraction of its flight.
    fn mean_place(&self, fraction: f64) -> Point3<f64> {
        let place = |it: &SampledFlight| it.p_WO[(fraction * (it.p_WO.len() - 1) as f64) as usize].coords;
        Point3::from(self.flights.iter().map(place).sum::<Vector3<f64>>() / self.flights.len().max(1) as f64)
    }

    /// Returns the instants of each throw at which a camera shows the object.
    pub fn sight(&self, camera: &CameraModel) -> Vec<Vec<bool>> {
        let X_WL = self.setup.robot.link_poses(&self.setup.robot.ready_q);
        let arm: Vec<_> = self.arm.parts(&X_WL, self.setup.gripper.max_width_m).collect();
        let eye = Point3::from(camera.X_WC.translation.vector);
        let hidden = |p_WO: &Point3<f64>| {
            arm.iter().any(|(X_WB, caster)| {
                let X_BW: Pose = X_WB.inverse();
                caster.cast_within(&(X_BW * eye), &(X_BW * (p_WO - eye)), 1.0).is_some()
            })
        };
        let range_m = camera.sheet.as_ref().and_then(|it| it.range_m);
        let [nearest_m, farthest_m] = range_m.unwrap_or([0.0, f64::INFINITY]);
        let radius_m = self.setup.object.bounding_radius_m;
        let shows = |p_WO: &Point3<f64>| {
            let p_C = camera.X_WC.inverse_transform_point(p_WO);
            let Some(uv) = camera.project(&p_C) else { return false };
            let radius_px = radius_m * camera.focal_px / p_C.z;
            let is_within = |at: f64, size: u32| at >= radius_px && at <= f64::from(size) - radius_px;
            (nearest_m..=farthest_m).contains(&p_C.z)
                && is_within(uv.x, camera.width_px)
                && is_within(uv.y, camera.height_px)
                && std::f64::consts::PI * radius_px * radius_px >= MIN_PIXELS
                && !hidden(p_WO)
        };
        self.flights.iter().map(|flight| flight.p_WO.iter().map(shows).collect()).collect()
    }

    /// Fisher information about position and velocity at the catch, throw by throw, in the images of a camera
    /// that have arrived `before_s` before it.
    fn information(&self, camera: &CameraModel, sight: &[Vec<bool>], before_s: f64) -> Vec<Matrix6<f64>> {
        let arena = &self.setup.scenario.arena;
        let rate_hz = camera.rate_hz.filter(|_| arena.free_running_cameras).unwrap_or(arena.frame_rate_hz);
        let late_s = before_s + arena.latency_s.bounds().into_iter().sum::<f64>() / 2.0;
        let sheet = camera.sheet.clone().unwrap_or_default();
        // Images of a camera are so much rarer than instants.
        let images = rate_hz * TICK_S;
        let of_flight = |(flight, shown): (&SampledFlight, &Vec<bool>)| {
            let mut sum = Matrix6::zeros();
            for (tick, (p_WO, _)) in flight.p_WO.iter().zip(shown).enumerate().filter(|(_, (_, shown))| **shown) {
                let ahead_s = tick as f64 * TICK_S - flight.catch_s;
                if ahead_s > -late_s {
                    break;
                }
                let weight = self.weight(camera, &sheet, p_WO) * images;
                for (row, row_factor) in [(0, 1.0), (3, ahead_s)] {
                    for (column, factor) in [(0, 1.0), (3, ahead_s)] {
                        let mut block = sum.fixed_view_mut::<3, 3>(row, column);
                        block += weight * (row_factor * factor);
                    }
                }
            }
            sum
        };
        self.flights.iter().zip(sight).map(of_flight).collect()
    }

    /// Inverse covariance in W of a position that one image measures.
    fn weight(&self, camera: &CameraModel, sheet: &DataSheet, p_WO: &Point3<f64>) -> Matrix3<f64> {
        let p_C = camera.X_WC.inverse_transform_point(p_WO);
        let pixels = std::f64::consts::PI * (self.setup.object.bounding_radius_m * camera.focal_px / p_C.z).powi(2);
        let depth_sd_m = sheet.constant_m + sheet.quadratic_per_m(camera.focal_px) * p_C.z * p_C.z;
        let own = (1.0 - sheet.common_fraction) / pixels.max(1.0);
        let along = depth_sd_m.powi(2) * (sheet.common_fraction + own) + LEAST_SD_M.powi(2);
        let across = (LATERAL_PX * p_C.z / camera.focal_px).powi(2) + LEAST_SD_M.powi(2);
        let ray_W = camera.X_WC.rotation * p_C.coords.normalize();
        let along_ray = ray_W * ray_W.transpose();
        along_ray / along + (Matrix3::identity() - along_ray) / across
    }
}

fn apart_m(one: &CameraModel, other: &CameraModel) -> f64 {
    (one.X_WC.translation.vector - other.X_WC.translation.vector).norm()
}

/// Standard deviation along each axis of the position at the catch, from what images tell and what is known
/// before.
fn deviation_m(information: &Matrix6<f64>) -> f64 {
    let mut sum = *information;
    for i in 0..6 {
        sum[(i, i)] += PRIOR_SD[i / 3].powi(-2);
    }
    let covariance = sum.cholesky().map(|it| it.inverse());
    covariance.map_or(f64::INFINITY, |it| (it.fixed_view::<3, 3>(0, 0).trace() / 3.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::setup::Choice;

    /// The box on whose walls the near rigs hang.
    const WALLS_M: [[f64; 3]; 2] = [[-1.0, -1.2, 0.4], [1.6, 1.6, 2.0]];

    fn setup() -> Setup {
        let settings = ["flight_rig=d435_1", "camera=d435", "arena.depth.model=near_stereo"].map(str::to_owned);
        Setup::load(&Choice {
            scenario: Some("paper"),
            throw: Some("random"),
            settings: &settings,
            ..Choice::default()
        })
        .unwrap()
    }

    fn config(cameras: usize) -> Config {
        Config { cameras, throws: 12, spacing_m: 0.8, ..Config::default() }
    }

    /// Without images it is what is known before.
    #[test]
    fn the_deviation_is_that_of_the_images() {
        let mut information = Matrix6::zeros();
        information.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::identity() * 1e6));
        information.fixed_view_mut::<3, 3>(3, 3).copy_from(&(Matrix3::identity() * 1e6));
        assert!((deviation_m(&information) - 1e-3).abs() < 1e-8);
        assert!((deviation_m(&Matrix6::zeros()) - PRIOR_SD[0]).abs() < 1e-12);
    }

    #[test]
    fn what_the_arm_and_the_border_hide_is_not_shown() {
        let (setup, config) = (setup(), config(1));
        let study = PlacementStudy::new(&setup, &config).unwrap();
        let p_WG = Point3::from(setup.robot.gripper_pose(&setup.robot.ready_q).translation.vector);
        let flight = |p_WO: Vec<Point3<f64>>| SampledFlight { catch_s: 0.0, p_WO };
        let ahead_m = |camera: &CameraModel, p_C: [f64; 3]| camera.X_WC * Point3::from(p_C);
        // From above, the hand between camera and object; then past it, and beside the image.
        let eye = p_WG + Vector3::new(0.0, 0.0, 1.0);
        let above =
            CameraModel { X_WC: look_at(&eye, &(p_WG + Vector3::new(0.01, 0.0, 0.0))), ..setup.cameras[0].clone() };
        let behind = p_WG - Vector3::new(0.0, 0.0, 0.3);
        let places = vec![
            behind,
            ahead_m(&above, [0.5, 0.3, 1.2]),
            ahead_m(&above, [3.0, 0.0, 1.0]),
            ahead_m(&above, [0.0, 0.0, 30.0]),
        ];
        let study = PlacementStudy { flights: vec![flight(places)], ..study };
        assert_eq!(study.sight(&above), [[false, true, false, false]]);
    }

    #[test]
    fn cameras_that_are_placed_tell_more_than_others_and_more_of_them_more() {
        let (setup, one, two) = (setup(), config(1), config(2));
        let kind = &setup.cameras[0];
        let study = PlacementStudy::new(&setup, &one).unwrap();
        let best = study.place(kind).unwrap();
        let (cameras, candidates) = &best;
        let mean = |it: &Score| {
            it.flights.iter().map(|it| libm::log(it.decision_sd_m) + libm::log(it.closing_sd_m)).sum::<f64>()
        };
        let placed = study.score(cameras);
        assert!(*candidates > 50 && placed.shown.len() == 1 && placed.shown_by_one == placed.shown[0]);
        for other in study.candidates(kind).iter().step_by(17) {
            assert!(mean(&study.score(std::slice::from_ref(other))) >= mean(&placed) - 1e-9);
        }
        let pair = PlacementStudy::new(&setup, &two).unwrap();
        let of_pair = pair.score(&pair.place(kind).unwrap().0);
        let closing_m = |it: &Score| it.quantile_m(|it| it.closing_sd_m, 0.5);
        assert!(closing_m(&of_pair) < closing_m(&placed));
        assert!(of_pair.shown_by_two <= of_pair.shown_by_one);
        assert_eq!(study.place(kind).unwrap(), best, "always the same");
    }

    #[test]
    fn cameras_that_show_little_of_the_arm_are_left_out() {
        let (setup, any) = (setup(), Config { arm_fraction: 0.0, ..config(1) });
        let some = Config { arm_fraction: 0.8, ..any.clone() };
        let [all, kept] = [&any, &some].map(|config| {
            let study = PlacementStudy::new(&setup, config).unwrap();
            let cameras = study.candidates(&setup.cameras[0]);
            study.score(&cameras).arm_shown
        });
        assert!(kept.len() > 50 && kept.iter().all(|it| *it >= 0.8), "{kept:?}");
        assert_eq!(kept, all.into_iter().filter(|it| *it >= 0.8).collect::<Vec<_>>());
    }

    /// Checks that the near rigs are placed as the commands in their files state.
    #[test]
    fn the_near_rigs_are_placed() {
        let is_placed = |scenario: &str, throw: &str, rig: &str, volume_m: [[f64; 3]; 2]| {
            let settings =
                [format!("flight_rig={rig}"), "camera=d435".to_owned(), "arena.depth.model=near_stereo".to_owned()];
            let choice =
                Choice { scenario: Some(scenario), throw: Some(throw), settings: &settings, ..Choice::default() };
            let setup = Setup::load(&choice).unwrap();
            let config = Config { cameras: setup.cameras.len(), volume_m, ..Config::default() };
            let placed = PlacementStudy::new(&setup, &config).unwrap().place(&setup.cameras[0]).unwrap().0;
            for (found, stored) in placed.iter().zip(&setup.cameras) {
                let apart = found.X_WC.inverse() * stored.X_WC;
                assert!(apart.translation.vector.norm() < 1e-6 && apart.rotation.angle() < 1e-6, "{rig}");
            }
        };
        for rig in ["d435_1", "d435_2", "d435_3", "d435_4"] {
            is_placed("honest", "random", rig, WALLS_M);
        }
        is_placed("lab", "by_hand", "d435_lab", Config::default().volume_m);
    }

    /// On every wall and on the ceiling, whatever rounding makes of the corners.
    #[test]
    fn every_wall_has_places() {
        let setup = setup();
        for volume_m in [[[-1.2, -1.6, 0.4], [2.2, 2.2, 2.2]], [[-1.0, -1.5, 0.5], [2.0, 2.0, 1.9]]] {
            let config = Config { volume_m, spacing_m: 0.4, clear_m: 0.1, arm_fraction: 0.0, ..config(1) };
            let candidates = PlacementStudy::new(&setup, &config).unwrap().candidates(&setup.cameras[0]);
            let on = |axis: usize, at: f64| {
                candidates.iter().filter(|it| (it.X_WC.translation.vector[axis] - at).abs() < 1e-9).count()
            };
            let [from, to] = volume_m;
            for (axis, at) in [(0, from[0]), (0, to[0]), (1, from[1]), (1, to[1]), (2, to[2])] {
                assert!(on(axis, at) > 20, "axis {axis} at {at}: {}", on(axis, at));
            }
        }
    }

    #[test]
    fn what_cannot_be_placed_is_said() {
        let setup = setup();
        let fault = |config: Config| PlacementStudy::new(&setup, &config).map(drop).unwrap_err().to_string();
        let swapped = fault(Config { volume_m: [[1.0; 3], [0.0; 3]], ..config(1) });
        assert!(swapped.contains("--from and --to"), "{swapped}");
        let dense = fault(Config { spacing_m: 0.05, throws: 1000, ..config(1) });
        assert!(dense.contains("--spacing and --trials"), "{dense}");
        let everywhere = Config { clear_m: 20.0, ..config(1) };
        let study = PlacementStudy::new(&setup, &everywhere).unwrap();
        assert!(study.place(&setup.cameras[0]).unwrap_err().to_string().contains("no such place"));
    }
}
