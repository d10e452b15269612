//! Views of flights in the rigs of near cameras, with the arm in its waiting pose between them.

use catch_body::{Pose, dynamics};
use catch_cell::rig_from_toml;

use super::*;
use crate::{ArenaConfig, Throw, ThrownObject, conditions::Conditions};

const RIGS: [&str; 4] = ["d435_1", "d435_2", "d435_3", "d435_4"];

/// Pixels of a ball that say something about where it is.
const MIN_PIXELS: usize = 30;
/// Images in which a ball that nobody caught passes the arm's own body.
const AFTER_CATCH: usize = 9;

/// Visibility in a rig of the first throws of a kind, from the release until the ball is nearest to the
/// base's axis, every 10 ms.
fn seen(rig: &str, throw: &str, throws: u64) -> Vec<Flight> {
    let read =
        |path: &str| std::fs::read_to_string(format!("{}/../../assets/{path}", env!("CARGO_MANIFEST_DIR"))).unwrap();
    let cameras = rig_from_toml(rig, &read(&format!("rigs/{rig}.toml"))).unwrap();
    let throw = Throw::from_toml(throw, &read(&format!("throws/{throw}.toml"))).unwrap();
    let object = read("objects/tennis_ball/truth.toml");
    let object = ThrownObject::from_toml("tennis_ball", &object, &|file| panic!("no file is needed: {file}")).unwrap();
    let robot = iiwa();
    // The waiting pose of the scenario `paper`.
    let q = robot.joint_vector(&[-1.308, 1.236, 1.116, -1.523, 1.648, 1.472, 0.272]).unwrap();
    let X_WL = robot.link_poses(&q);
    let renderer = renderer(&ball(), true);
    let flight = |index| {
        let release =
            throw.release("tennis_ball", &Conditions::draw(&ArenaConfig::default(), &object, 0, index), 0, index);
        let at = |time_s: f64| release.p_WO + release.v_WO * time_s + dynamics::gravity() * (time_s * time_s / 2.0);
        // Until it is nearest to the base's axis.
        let horizontal = |time_s: f64| libm::hypot(at(time_s).x, at(time_s).y);
        let passage =
            (0..150).min_by(|a, b| horizontal(f64::from(*a) / 100.0).total_cmp(&horizontal(f64::from(*b) / 100.0)));
        let mut flight = Flight::default();
        for tick in 0..passage.unwrap() {
            let X_WO = Pose::from(at(f64::from(tick) / 100.0).coords);
            let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO };
            let frames = exact_images(&renderer, &cameras, &scene, Readout::Object, true);
            let pixels = |frame: &catch_cell::DepthFrame| frame.mask.iter().flatten().filter(|shown| **shown).count();
            let seeing = frames.iter().filter(|frame| pixels(frame) >= MIN_PIXELS).count();
            flight.cameras.push(seeing);
        }
        flight
    };
    (0..throws).map(flight).collect()
}

/// Number of cameras in which the ball shows enough pixels, image by image.
#[derive(Debug, Default)]
struct Flight {
    cameras: Vec<usize>,
}

impl Flight {
    /// Fraction of the images that at least so many cameras see.
    fn fraction(&self, cameras: usize) -> f64 {
        self.cameras.iter().filter(|seeing| **seeing >= cameras).count() as f64 / self.cameras.len() as f64
    }

    /// The images until it is where it is caught at the latest.
    fn until_caught(&self) -> Self {
        let until = self.cameras.len().saturating_sub(AFTER_CATCH);
        Self { cameras: self.cameras[..until].to_vec() }
    }

    /// The last images of it.
    fn last(&self, images: usize) -> Self {
        let from = self.cameras.len().saturating_sub(images);
        Self { cameras: self.cameras[from..].to_vec() }
    }
}

#[test]
fn near_cameras_see_the_papers_throws_until_they_are_caught() {
    for (rig, cameras) in RIGS.into_iter().zip([1, 2, 2, 2]) {
        for throw in ["near", "far"] {
            for flight in seen(rig, throw, 1).iter().map(Flight::until_caught) {
                assert!(
                    flight.fraction(1) == 1.0 && flight.last(20).fraction(cameras) == 1.0,
                    "{rig} {throw}: {flight:?}"
                );
            }
        }
    }
}
