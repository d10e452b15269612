//! Cost of a wrong belief: one figure of the brain's model wrong at a time, on the same throws as with the
//! right one.

use anyhow::Result;
use catch_body::TriangleMesh;
use catch_cell::reference_scan;
use catch_lab::{assets::Kind, scenario::setup::Setup};
use nalgebra::Vector3;

use crate::{
    Options, kept,
    rates::{self, judged},
    results::{Entry, Table},
    spread::{gained, percent},
};

/// Parts of the throws that are evaluated and kept together.
const PART: u64 = 10;
/// A change of a setup before anything is prepared.
type Change = fn(&mut Setup, f64);

/// Values that a belief takes, by their names.
type Values = &'static [(&'static str, f64)];

/// Each belief with the values that it takes.
const BELIEFS: &[(&str, Values, Change)] = &[
    ("drag", &[("× 0.5", 0.5), ("× 2", 2.0)], |it, by| it.known_object.figures.drag_per_m *= by),
    ("depth noise", &[("× 0.5", 0.5), ("× 2", 2.0)], |it, by| each_sheet(it, |sheet| sheet.subpixel_px *= by)),
    ("common fraction", &[("0", 0.0), ("1", 1.0)], |it, to| each_sheet(it, |sheet| sheet.common_fraction = to)),
    ("centre of mass", &[("5 mm off", 0.005)], move_centre_of_mass),
    ("mass", &[("× 0.7", 0.7), ("× 1.4", 1.4)], |it, by| {
        it.known_object.figures.mass_kg = it.known_object.figures.mass_kg.map(|mass_kg| mass_kg * by);
    }),
    ("restitution", &[("− 0.3", -0.3), ("+ 0.3", 0.3)], |it, by| {
        let restitution = &mut it.known_object.figures.restitution;
        *restitution = restitution.map(|e| (e + by).clamp(0.0, 1.0));
    }),
    ("size", &[("− 1 mm", -0.001), ("+ 1 mm", 0.001)], grow_scan),
    ("spin prior", &[("× 0.3", 0.3), ("× 3", 3.0)], |it, by| {
        it.scenario.brain.trajectory_prediction.spin_prior_sd_radps *= by;
    }),
    ("camera rotations", &[("σ × 0.5", 0.5), ("σ × 2", 2.0)], |it, by| {
        it.scenario.brain.perception.camera_sd_rad *= by;
    }),
    ("gripper latency", &[("− 5 ms", -0.005), ("+ 5 ms", 0.005)], |it, by| {
        it.scenario.brain.control.gripper_latency_s = Some(it.gripper.drive.latency_s + by);
    }),
];

/// Scenarios with noisy cameras.
const SCENARIOS: [&str; 2] = ["honest", "lab"];

/// Every object and belief in them.
pub fn run(options: &Options) -> Result<Vec<Table>> {
    let objects = Kind::Object.names();
    let mut rates =
        Table::new("Caught with right beliefs", &["scenario", "object", "throws", "caught, %"]).across("object");
    let mut right = Vec::new();
    for scenario in SCENARIOS {
        for object in &objects {
            let caught = Case { scenario, object, belief: "right", value: "" }.caught(options, &|_| {})?;
            let rate = percent(caught.iter().filter(|it| **it).count(), caught.len());
            rates.rows.push(vec![Entry::text(scenario), Entry::text(*object), Entry::Count(caught.len()), rate]);
            right.push(caught);
        }
    }
    let columns = [&["belief", "value", "scenario"][..], &objects, &["all, points"]].concat();
    let mut costs = Table::new("What a wrong belief costs", &columns).across("scenario");
    for (belief, values, change) in BELIEFS {
        for (value, amount) in *values {
            for (scenario, right) in SCENARIOS.into_iter().zip(right.chunks(objects.len())) {
                let mut pairs = Vec::new();
                let mut row = [belief, value, scenario].map(Entry::text).to_vec();
                for (object, right) in objects.iter().zip(right) {
                    let wrong =
                        Case { scenario, object, belief, value }.caught(options, &|setup| change(setup, *amount))?;
                    let of_object: Vec<(bool, bool)> = right.iter().copied().zip(wrong).collect();
                    row.push(Entry::Number(Some(gained(&of_object)[0])));
                    pairs.extend(of_object);
                }
                row.push(Entry::Spread(gained(&pairs).into()));
                costs.rows.push(row);
            }
        }
    }
    Ok(vec![rates, costs])
}

/// Throws of one object with one belief.
struct Case<'a> {
    scenario: &'a str,
    object: &'a str,
    belief: &'a str,
    value: &'a str,
}

impl Case<'_> {
    /// Returns which throws are caught, of those kept by an earlier run or thrown now.
    fn caught(&self, options: &Options, change: &dyn Fn(&mut Setup)) -> Result<Vec<bool>> {
        let &Options { seed, trials, .. } = options;
        let mut setup = rates::setup(self.scenario, self.object)?;
        change(&mut setup);
        let mut caught: Vec<bool> = Vec::new();
        for first in (0..trials).step_by(PART as usize) {
            let count = PART.min(trials - first);
            let Self { scenario, object, belief, value } = self;
            let name = format!("{scenario}-{object}-{belief}-{value}-{seed}-{first}-{count}");
            let thrown = || Ok(judged(&setup, seed, first..first + count, |_, verdict| verdict.caught));
            caught.extend(kept::part("mistold", &name, thrown)?);
        }
        Ok(caught)
    }
}

fn each_sheet(setup: &mut Setup, change: impl Fn(&mut catch_cell::DataSheet)) {
    setup.cameras.iter_mut().filter_map(|it| it.sheet.as_mut()).for_each(change);
}

/// Moves the centre of mass along the object's longest axis; the scan is taken anew, from the same places
/// beside the object.
fn move_centre_of_mass(setup: &mut Setup, by_m: f64) {
    let size = setup.object.mesh.aabb().size;
    let mut to_com = Vector3::zeros();
    to_com[size.imax()] = -by_m;
    let object = &mut setup.object;
    object.mesh = object.mesh.clone().translated(&to_com);
    object.parts = object.parts.drain(..).map(|part| part.translated(&to_com)).collect();
    object.bounding_radius_m = object.mesh.bounding_radius();
    scan(setup, &setup.object.mesh.clone());
}

/// Scans an object whose every extent is so much larger.
fn grow_scan(setup: &mut Setup, by_m: f64) {
    let mut mesh = setup.object.mesh.clone();
    let mut normals = vec![Vector3::zeros(); mesh.vertices.len()];
    for (triangle, [a, b, c]) in mesh.triangles.iter().zip(mesh.all_corners()) {
        let normal = (b - a).cross(&(c - a));
        triangle.iter().for_each(|&vertex| normals[vertex as usize] += normal);
    }
    for (vertex, normal) in mesh.vertices.iter_mut().zip(normals) {
        *vertex += normal.try_normalize(0.0).unwrap_or_default() * (by_m / 2.0);
    }
    scan(setup, &mesh);
}

fn scan(setup: &mut Setup, mesh: &TriangleMesh) {
    setup.known_object.scan = reference_scan(mesh, &setup.known_object.scan.cameras);
}

#[cfg(test)]
mod tests {
    use catch_lab::scenario::setup::Choice;

    use super::*;

    #[test]
    fn each_wrong_belief_changes_what_is_known_or_the_object_alone() {
        let load = || Setup::load(&Choice { scenario: Some("honest"), object: Some("banana"), ..Choice::default() });
        let right = load().unwrap();
        for (belief, values, change) in BELIEFS {
            for (value, amount) in *values {
                let mut wrong = load().unwrap();
                change(&mut wrong, *amount);
                let is_same_scan = right.known_object.scan.frames.len() == wrong.known_object.scan.frames.len()
                    && format!("{:?}", right.known_object.scan) == format!("{:?}", wrong.known_object.scan);
                let is_same = is_same_scan && right.brain_config(1) == wrong.brain_config(1);
                assert!(!is_same, "{belief} {value}: nothing is wrong");
                assert_eq!(right.scenario.arena, wrong.scenario.arena, "{belief} {value}");
                assert_eq!(right.conditions(1, 0), wrong.conditions(1, 0), "{belief} {value}");
            }
        }
    }

    #[test]
    fn a_grown_scan_is_larger_by_the_stated_length() {
        let mut setup = Setup::load(&Choice { object: Some("tennis_ball"), ..Choice::default() }).unwrap();
        let before = setup.known().reference.volume_m3;
        let mut grown = Setup::load(&Choice { object: Some("tennis_ball"), ..Choice::default() }).unwrap();
        grow_scan(&mut grown, 0.001);
        let ratio = libm::cbrt(grown.known().reference.volume_m3 / before);
        assert!((ratio - 68.2 / 67.2).abs() < 1e-3, "{ratio}");
        move_centre_of_mass(&mut setup, 0.005);
        assert!((setup.object.mesh.mass_properties(1.0).com.coords.norm() - 0.005).abs() < 1e-4);
    }
}
