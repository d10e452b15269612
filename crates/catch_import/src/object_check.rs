//! Examination of an object as the brain would see it: its reference model, and the number of grasps that
//! each scenario leaves.

use catch_bot::{
    grasp_selection::GraspSet,
    perception::{ReferenceModel, Symmetry},
};
use catch_cell::ReferenceScan;
use catch_sim::ThrownObject;

use catch_lab::{
    assets::{Asset, Kind},
    scenario::setup::{Choice, DEFAULT_SCENARIO, Setup},
};

/// Result of an examination.
#[derive(Debug, Clone, Default)]
pub(super) struct Examined {
    /// A line each.
    pub notes: Vec<String>,
    /// Reason why no scenario has a grasp, if none has.
    pub not_held: Option<String>,
}

/// A reference model differs from the mesh by more than this: it is worth a warning.
const VOLUME_OFF: f64 = 0.15;
const CENTRE_OFF_M: f64 = 0.002;

/// Looks at an object as each built-in scenario shows it to the brain.
pub(super) fn examine(asset: &Asset) -> Examined {
    let mut examined = Examined::default();
    let mut models: Vec<(ReferenceScan, ReferenceModel)> = Vec::new();
    let mut counts = Vec::new();
    for scenario in Kind::Scenario.names() {
        let choice = Choice { scenario: Some(scenario), object: Some(&asset.file), ..Choice::default() };
        // A scenario that asks for more than the file has is none for it.
        let Ok(setup) = Setup::load(&choice) else { continue };
        let config = setup.uncalibrated_config().config();
        let known = models.iter().position(|(scan, _)| is_same(scan, &setup.known_object.scan));
        let index = known.unwrap_or_else(|| {
            let model = ReferenceModel::from_scan(&setup.known_object.scan);
            models.push((setup.known_object.scan.clone(), model));
            models.len() - 1
        });
        let reference = &models[index].1;
        if scenario == DEFAULT_SCENARIO {
            examined.notes.extend(notes_of_model(&setup.object, reference));
        }
        let grasps = GraspSet::sample(reference, &setup.gripper, &config.grasp_selection);
        if grasps.grasps.is_empty() && examined.not_held.is_none() {
            examined.not_held = Some(setup.why_without_grasps(&grasps));
        }
        counts.push((scenario, grasps.grasps.len()));
    }
    let list: Vec<String> = counts.iter().map(|(scenario, count)| format!("{count} in {scenario}")).collect();
    if !list.is_empty() {
        examined.notes.push(format!("grasps: {}", list.join(", ")));
    }
    let held_somewhere = counts.iter().any(|(_, count)| *count > 0);
    examined.not_held = examined.not_held.filter(|_| !held_somewhere);
    examined
}

/// Returns whether two scans are the same, bit for bit; what was not measured is equal to nothing.
fn is_same(one: &ReferenceScan, other: &ReferenceScan) -> bool {
    let bits = |scan: &ReferenceScan| -> Vec<u32> {
        scan.frames.iter().flat_map(|it| &it.depth_m).map(|depth| depth.to_bits()).collect()
    };
    one.cameras == other.cameras && bits(one) == bits(other)
}

/// Notes on the model, and on how it differs from the object.
fn notes_of_model(object: &ThrownObject, reference: &ReferenceModel) -> Vec<String> {
    let uniform = object.mesh.mass_properties(object.mass_kg).com;
    let centre = reference.X_RO.translation.vector;
    let (off_m, true_off_m) = ((centre - uniform.coords).norm(), centre.norm());
    let volumes = [reference.volume_m3, object.mesh.volume()].map(|it| it * 1e6);
    let symmetry = match &reference.symmetry {
        Symmetry::Sphere => "a sphere's".to_owned(),
        Symmetry::Axis { reversible: true, .. } => "about an axis, which may be reversed".to_owned(),
        Symmetry::Axis { .. } => "about an axis".to_owned(),
        Symmetry::Finite { group, .. } if group.order() == 1 => "none".to_owned(),
        Symmetry::Finite { group, .. } => format!("a group of {} rotations", group.order()),
    };
    let mut notes = vec![
        format!(
            "the brain's model: volume {:.1} cm³ (the mesh: {:.1}), inner ball of {:.1} mm radius, symmetry: {symmetry}",
            volumes[0],
            volumes[1],
            reference.inner_radius_m * 1e3
        ),
        format!(
            "its centre of mass is {:.1} mm from that of uniform density, {:.1} mm from the true one",
            off_m * 1e3,
            true_off_m * 1e3
        ),
    ];
    if off_m > CENTRE_OFF_M || (volumes[0] / volumes[1] - 1.0).abs() > VOLUME_OFF {
        notes.push(
            "warning: the brain's model differs from the mesh; thin walls and deep openings are hard to scan"
                .to_owned(),
        );
    }
    notes
}
